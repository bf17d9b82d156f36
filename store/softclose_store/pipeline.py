"""Owns one shortcut through zarr's writing: a chunk that is complete goes straight through its codecs.

zarr 3.1's pipeline reads, merges and batches chunks that may be partial; for whole chunks all of that does nothing and
costs more than a small file does. The codecs, the metadata and the keys stay zarr's: what is written is the same.
"""

from __future__ import annotations

from typing import Any

import zarr.registry

_Default: Any = zarr.registry.get_pipeline_class()


class WholeChunkPipeline(_Default):  # type: ignore[misc]
    """zarr's own pipeline, with a short way for one complete chunk at a time; anything else goes zarr's way."""

    async def write(self, batch_info: Any, value: Any, drop_axes: Any = ()) -> None:
        """Encode and store chunks of `value`."""
        chunks = list(batch_info)
        direct = hasattr(self.array_bytes_codec, "_encode_single") and not self.array_array_codecs
        if len(chunks) != 1 or not direct or drop_axes or self.supports_partial_encode:
            await super().write(chunks, value, drop_axes)
            return
        setter, spec, _, _, is_complete = chunks[0]
        if not is_complete or tuple(value.shape) != tuple(spec.shape):
            await super().write(chunks, value, drop_axes)
            return
        encoded = await self.array_bytes_codec._encode_single(value, spec)
        for codec in self.bytes_bytes_codecs:
            encoded = await codec._encode_single(encoded, spec)
        await setter.set(encoded)


zarr.registry.register_pipeline(WholeChunkPipeline)
PIPELINE = f"{WholeChunkPipeline.__module__}.{WholeChunkPipeline.__qualname__}"
"""Value of zarr's setting `codec_pipeline.path` for arrays that are opened for writing."""
