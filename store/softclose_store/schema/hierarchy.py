"""Owns the empty hierarchy: every array of a store with dimensions, type, unit, chunks and codecs, built in memory."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from zarr.abc.buffer import Buffer
from zarr.api.asynchronous import consolidate_metadata, create_group
from zarr.codecs import BloscCodec, Crc32cCodec, ZstdCodec
from zarr.storage import MemoryStore

from softclose_store.disk.loop import run_here
from softclose_store.disk.names import CHUNK_KEY_SEPARATOR, is_chunk_key
from softclose_store.errors import LayoutError
from softclose_store.schema import digests
from softclose_store.schema.fields import (
    DIGESTS,
    IMPACT_QUANTITIES,
    N_SURROGATE,
    QUANTITIES,
    SCHEMA_VERSION,
    WALL,
    WORDS,
    Field,
)
from softclose_store.schema.layout import Layout, StageLayout
from softclose_store.schema.root import (
    BACKUP_KEY,
    KIND,
    ROOT_KEY,
    RUNTIME_KEY,
    SCHEMA_ATTRIBUTE,
    Root,
    runtime_text,
)

KEYS: Any = {"name": "default", "separator": CHUNK_KEY_SEPARATOR}

STATIC_CHUNK = 65_536
"""Rows in one chunk of a population array."""

Role = Literal["static", "table", "block", "marker"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArraySpec:
    """One array of the schema."""

    name: str
    """Name in the store, or in its stage's group."""
    dims: tuple[str, ...]
    """Dimension names."""
    dtype: str
    """numpy type, or "str" for text."""
    unit: str
    """Unit; "1" where there is none, or where a coordinate says it for each column."""
    long_name: str
    """What it is, in words."""
    role: Role
    """static: written by the creation; table: by the driver; block, marker: by workers."""


def _spec(role: Role, name: str, dims: str, dtype: str, unit: str, long_name: str) -> ArraySpec:
    return ArraySpec(name=name, dims=tuple(dims.split()), dtype=dtype, unit=unit, long_name=long_name, role=role)


TABLES = {
    s.name: s
    for s in (
        _spec("table", "surrogate", "candidate hyperparameter", "f8", "1", "what the proposal's surrogate believed"),
        _spec("table", "words", "candidate word", "str", "1", "what is said of a candidate in words"),
        _spec("table", "wall_times", "candidate wall_time", "f8", "s", "timings, which two runs do not share"),
        _spec("table", "records", "candidate field", "f8", "see field_unit", "waveform, objective, intervals …"),
        _spec("table", "digests", "candidate digest", "u8", "1", "xxh3 of what is stored of a candidate; 0: nothing"),
    )
}
"""Tables at the root, one row a candidate, in the order in which a commit writes them."""

_CST = "stage_candidate stage_switch"
BLOCK_SPECS = {
    s.name: s
    for s in (
        _spec("block", "response", f"{_CST} quantity", "f8", "see quantity_unit", "what is kept of a switch"),
        _spec(
            "block", "impact", f"{_CST} event impact_quantity", "f8", "µs, µm/µs", "time and speed of the first impacts"
        ),
        _spec("block", "x", f"{_CST} time", "f4", "µm", "travel x(t)"),
        _spec("block", "v", f"{_CST} time", "f4", "µm/µs", "velocity v(t)"),
    )
}
"""Arrays of a stage that workers write, one chunk a block."""

MARKER = _spec(
    "marker", "block_digest", "block_candidate block_switch marker", "u8", "1", "xxh3 of each block; 0: not written"
)
"""Array of a stage that says which blocks are stored: written last."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Static:
    """An array that the creation writes once and for all, or a coordinate that only grows (hyperparameter)."""

    dims: tuple[str, ...]
    """Dimension names."""
    values: NDArray[Any]
    """Its values."""
    unit: str = "1"
    """Unit."""
    long_name: str
    """What it is, in words."""


def static_arrays(layout: Layout, population: Mapping[str, NDArray[np.float64]]) -> dict[str, Static]:
    """Every static array of a store, by its name from the root."""
    arrays = {
        c.name: Static(dims=("switch",), values=population[c.name], unit=c.unit, long_name=c.long_name)
        for c in layout.columns
    }
    fields = layout.fields
    arrays |= {
        "field": _names("field", fields, "columns of records"),
        "field_unit": _texts("field", [f.unit for f in fields], "units of the columns of records"),
        "field_long_name": _texts("field", [f.long_name for f in fields], "meanings of the columns of records"),
        "word": _names("word", WORDS, "columns of words"),
        "digest": _texts("digest", DIGESTS, "what a digest is of"),
        "wall_time": _names("wall_time", WALL, "columns of wall_times"),
    }
    for stage in layout.stages:
        stage_arrays = {
            "quantity": _names("quantity", QUANTITIES, "columns of response"),
            "quantity_unit": _texts("quantity", [q.unit for q in QUANTITIES], "units of the columns of response"),
        }
        if layout.max_impacts:
            stage_arrays["impact_quantity"] = _names("impact_quantity", IMPACT_QUANTITIES, "columns of impact")
        if layout.times_us.size:
            stage_arrays["time"] = Static(
                dims=("time",), values=layout.times_us, unit="µs", long_name="time since the first pulse starts"
            )
        arrays |= {f"{stage.name}/{name}": static for name, static in stage_arrays.items()}
    return arrays


def _texts(dim: str, texts: Sequence[str], long_name: str) -> Static:
    return Static(dims=(dim,), values=np.array(texts, dtype=np.dtypes.StringDType()), long_name=long_name)


def _names(dim: str, fields: Sequence[Field], long_name: str) -> Static:
    return _texts(dim, [field.name for field in fields], long_name)


def fast_codec(typesize: int | None = None) -> BloscCodec:
    """lz4 after byte shuffling, in blocks that fit a cache: of those measured the fast enough one (docs/adr/022).

    typesize: bytes of a whole row of columns, so that each column is compressed by itself.
    """
    return BloscCodec(cname="lz4", clevel=1, shuffle="shuffle", blocksize=65_536, typesize=typesize)


def sparse_codec() -> BloscCodec:
    """lz4 for impacts, most of which are NaN: shuffling them costs twice the time and a quarter more bytes."""
    return BloscCodec(cname="lz4", clevel=9, shuffle="noshuffle", blocksize=65_536)


def text_codec() -> ZstdCodec:
    """zstd for text, and for nothing else: bytes of another array in a text's place are refused by their first four.

    The text's own codec believes them, takes them for a number of words, and asks for up to 34 GB of memory.
    """
    return ZstdCodec(level=1)


def population_columns(layout: Layout, population: Mapping[str, ArrayLike]) -> dict[str, NDArray[np.float64]]:
    """The columns of a population as they are stored; raises LayoutError."""
    names, n = [c.name for c in layout.columns], layout.n_switches
    if set(population) != set(names):
        raise LayoutError(f"the population has columns {sorted(population)}; it needs {sorted(names)}")
    columns = {name: np.ascontiguousarray(population[name], dtype=np.float64) for name in names}
    for name, column in columns.items():
        if column.shape != (n,) or not np.all(np.isfinite(column)):
            raise LayoutError(f"population column {name} has shape {column.shape}; it must be ({n},), all finite")
    return columns


def build_hierarchy(
    layout: Layout,
    *,
    config: Mapping[str, Any],
    fingerprint: str,
    algorithm: str,
    population: Mapping[str, NDArray[np.float64]],
    runtime: Mapping[str, Any],
    durable: bool,
) -> dict[str, bytes]:
    """The whole empty hierarchy in memory: key -> bytes."""
    statics = static_arrays(layout, population)
    contents = schema_of(layout) | _filled(statics)
    document = json.loads(contents[ROOT_KEY])
    document["attributes"] = {
        "kind": KIND,
        SCHEMA_ATTRIBUTE: SCHEMA_VERSION,
        "fingerprint": fingerprint,
        "algorithm": algorithm,
        "config": dict(config),
        "layout": layout.to_dict(),
        "durable": durable,
        "static_digests": {name: digests.array_sha256(static.values) for name, static in statics.items()},
        "metadata_digest": metadata_digest(contents),
    }
    root = Root(document).with_runtime(runtime)
    contents[ROOT_KEY] = contents[BACKUP_KEY] = root.committed(0, 0, ()).encode()
    contents[RUNTIME_KEY] = runtime_text(root)
    return contents


def schema_of(layout: Layout) -> dict[str, bytes]:
    """The metadata of every array and group of a store of this layout, the root's without attributes: key -> bytes.

    Nothing is allocated by the layout's sizes: they may come out of a store that somebody made up.
    """
    return dict(_schema(digests.canonical_json(layout.to_dict())))


@lru_cache(maxsize=16)
def _schema(sizes: str) -> Mapping[str, bytes]:
    data = json.loads(sizes)
    layout = Layout.from_dict(data, np.arange(float(data["n_times"])))
    nothing = np.broadcast_to(np.float64(0.0), layout.n_switches)
    buffers: dict[str, Buffer] = {}
    memory = MemoryStore(buffers)

    async def create() -> None:
        group = await create_group(store=memory)
        for stage in layout.stages:
            attributes = {"first_candidate": layout.first(stage.name), "n_candidates": stage.n_candidates}
            await group.create_group(stage.name, attributes=attributes)
        for name, static in static_arrays(layout, dict.fromkeys([c.name for c in layout.columns], nothing)).items():
            await group.create_array(name, **_static_options(static))
        await group.create_array(HYPERPARAMETER, **_static_options(_no_hyperparameters()))
        for spec in TABLES.values():
            await group.create_array(spec.name, **_table_options(layout, spec))
        for stage in layout.stages:
            for spec in stage_specs(layout):
                await group.create_array(f"{stage.name}/{spec.name}", **_stage_options(layout, stage, spec))
        await group.create_group("runtime")
        await consolidate_metadata(memory)

    with warnings.catch_warnings():
        # The Zarr v3 specification does not cover consolidated metadata yet; zarr says so wherever it writes them.
        warnings.filterwarnings("ignore", message="Consolidated metadata is currently not part")
        run_here(create(), memory)
    return {key: value.to_bytes() for key, value in buffers.items()}


def _filled(statics: Mapping[str, Static]) -> dict[str, bytes]:
    """The chunks of the static arrays: key -> bytes."""
    buffers: dict[str, Buffer] = {}
    memory = MemoryStore(buffers)

    async def create() -> None:
        group = await create_group(store=memory)
        for name, static in {**statics, HYPERPARAMETER: _no_hyperparameters()}.items():
            array = await group.create_array(name, **_static_options(static))
            await array.setitem(Ellipsis, static.values)

    run_here(create(), memory)
    return {key: value.to_bytes() for key, value in buffers.items() if is_chunk_key(key)}


def stage_specs(layout: Layout) -> Iterator[ArraySpec]:
    """The arrays of a stage that are no coordinates, the marker last."""
    yield from (BLOCK_SPECS[name] for name in layout.block_arrays)
    yield MARKER


def metadata_digest(contents: Mapping[str, bytes]) -> str:
    """sha256 over the metadata documents of all arrays and stages of the schema: key -> bytes, others are ignored."""
    keys = sorted(k for k in contents if k.endswith("/zarr.json") and k != RUNTIME_KEY)
    return digests.sha256(b"".join(k.encode() + b"\0" + contents[k] + b"\0" for k in keys))


def _static_options(static: Static) -> dict[str, Any]:
    is_text = static.values.dtype.kind == "T"
    return {
        "shape": static.values.shape,
        "chunks": tuple(max(1, min(n, STATIC_CHUNK)) for n in static.values.shape),
        "dtype": "str" if is_text else static.values.dtype,
        "dimension_names": static.dims,
        "compressors": [text_codec() if is_text else fast_codec(), Crc32cCodec()],
        "fill_value": "" if is_text else 0,
        "attributes": {"units": static.unit, "long_name": static.long_name},
        "chunk_key_encoding": KEYS,
        "config": {"write_empty_chunks": True},
    }


HYPERPARAMETER = "hyperparameter"
"""Coordinate of `surrogate`: names of what surrogates said so far, then "". The root says them too, and is right."""


def _no_hyperparameters() -> Static:
    return _texts(
        HYPERPARAMETER, [""] * N_SURROGATE, "columns of surrogate, in the order in which they were first used"
    )


def _table_options(layout: Layout, spec: ArraySpec) -> dict[str, Any]:
    columns = {"field": len(layout.fields), "word": len(WORDS), "wall_time": len(WALL)}
    columns |= {"hyperparameter": N_SURROGATE, "digest": len(DIGESTS)}
    n = columns[spec.dims[1]]
    attributes: dict[str, Any] = {"units": spec.unit, "long_name": spec.long_name}
    if spec.name == "records":
        attributes["coordinates"] = "field_unit field_long_name"
    is_text = spec.dtype == "str"
    return {
        "shape": (layout.n_candidates, n),
        "chunks": (layout.table_chunk, n),
        "dtype": spec.dtype,
        "compressors": [text_codec() if is_text else fast_codec(), Crc32cCodec()],
        "fill_value": "" if is_text else (0 if spec.dtype == "u8" else np.nan),
        "dimension_names": spec.dims,
        "attributes": attributes,
        "chunk_key_encoding": KEYS,
    }


def _stage_options(layout: Layout, stage: StageLayout, spec: ArraySpec) -> dict[str, Any]:
    attributes: dict[str, Any] = {"units": spec.unit, "long_name": spec.long_name}
    shards: tuple[int, ...] | None = None
    compressors: list[Any]
    if spec.role == "marker":
        n = len(layout.marker_names)
        shape: tuple[int, ...] = (stage.n_block_candidates, stage.n_block_switches, n)
        chunks: tuple[int, ...] = (1, 1, n)
        compressors, fill = [Crc32cCodec()], 0.0
        attributes["names"] = list(layout.marker_names)
    else:
        rest, _ = layout.block_arrays[spec.name]
        row = 8 * len(QUANTITIES)
        shape = (stage.n_candidates, stage.n_switches, *rest)
        shards = (stage.block_candidates, stage.block_switches, *rest)
        chunks = (*stage.inner, *rest)
        codec = sparse_codec() if spec.name == "impact" else fast_codec(row if spec.name == "response" else None)
        compressors, fill = [codec, Crc32cCodec()], np.nan
        if spec.name == "response":
            attributes["coordinates"] = "quantity_unit"
    return {
        "shape": shape,
        "chunks": chunks,
        "shards": None if chunks == shards else shards,
        "dtype": spec.dtype,
        "compressors": compressors,
        "fill_value": fill if spec.role == "block" else 0,
        "dimension_names": spec.dims,
        "attributes": attributes,
        "chunk_key_encoding": KEYS,
    }
