"""Owns the root `zarr.json`: identity, layout and the commit marker.

The root carries consolidated metadata in which the `candidate` length of every table is the number of committed
candidates, and the `stage_candidate` length of every stage's arrays that of the stage. One atomic replacement of this
file commits a wave: readers of consolidated metadata (zarr, xarray, ours) see committed candidates only, while writers
open the arrays themselves at full capacity.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from softclose_store.schema import digests

ROOT_KEY = "zarr.json"
KIND = "softclose-campaign"
SCHEMA_ATTRIBUTE = "softclose_schema"
BACKUP_KEY = "digests/root.json"
"""The root as created, nothing committed: what a damaged root is rebuilt from. In an array's folder, where no Zarr tool
looks for members."""
EXTENSION_KEY = "digests/extension.json"
"""What a campaign will be whose extension is being written; there only meanwhile."""
RUNTIME_KEY = "runtime/zarr.json"
_NO_DIGEST = "-" * 64


@dataclass(frozen=True, slots=True)
class Root:
    """The decoded root metadata."""

    document: dict[str, Any]
    """The whole JSON document."""

    @property
    def attributes(self) -> dict[str, Any]:
        """The root group's attributes."""
        attributes: dict[str, Any] = self.document["attributes"]
        return attributes

    @property
    def metadata(self) -> dict[str, dict[str, Any]]:
        """Consolidated metadata: array or group name -> its document."""
        metadata: dict[str, dict[str, Any]] = self.document["consolidated_metadata"]["metadata"]
        return metadata

    @property
    def n_committed(self) -> int:
        """Number of committed candidates."""
        return int(self.attributes["n_committed"])

    @property
    def n_waves(self) -> int:
        """Number of committed waves."""
        return int(self.attributes["n_waves"])

    @property
    def fingerprint(self) -> str:
        """Identity of the campaign: sha256 of its configuration."""
        return str(self.attributes["fingerprint"])

    @property
    def algorithm(self) -> str:
        """Version of the algorithms that the campaign was begun with."""
        return str(self.attributes["algorithm"])

    def committed(self, n_candidates: int, n_waves: int, hyperparameters: Sequence[str]) -> Root:
        """The same root with so many committed candidates and waves, and the names of surrogate quantities so far."""
        lengths = {"": n_candidates}
        steps = {}
        first = 0
        for stage in self.attributes["layout"]["stages"]:
            lengths[stage["name"]] = min(max(n_candidates - first, 0), stage["n_candidates"])
            steps[stage["name"]] = stage["block_candidates"]
            first += stage["n_candidates"]
        metadata = {}
        for name, entry in self.metadata.items():
            stage_name = name.rpartition("/")[0]
            length = lengths.get(stage_name, 0)
            first_dimension = (entry.get("dimension_names") or [None])[0]
            if first_dimension == "block_candidate":
                length = -(-length // steps[stage_name])
            if first_dimension in COMMITTED:
                entry = {**entry, "shape": [length, *entry["shape"][1:]]}
            metadata[name] = entry
        attributes = {
            **self.attributes,
            "n_committed": n_candidates,
            "n_waves": n_waves,
            "hyperparameters": list(hyperparameters),
        }
        consolidated = {**self.document["consolidated_metadata"], "metadata": metadata}
        return Root({**self.document, "attributes": attributes, "consolidated_metadata": consolidated})

    def created(self) -> Root:
        """The root as the creation wrote it: nothing committed, no run noted."""
        attributes = self.metadata["runtime"]["attributes"]
        runtime = {name: value for name, value in attributes.items() if name != "runs"}
        return self.committed(0, 0, ()).with_runtime(runtime)

    def noted(self, run: Mapping[str, Any]) -> Root:
        """The same root with one more run in the attribute `runs` of the group `runtime`."""
        runtime = self.metadata["runtime"]
        attributes = {**runtime["attributes"], "runs": [*runtime["attributes"].get("runs", []), dict(run)]}
        return self.with_runtime(attributes)

    def with_runtime(self, attributes: Mapping[str, Any]) -> Root:
        """The same root with other attributes of the group `runtime`."""
        metadata = {**self.metadata, "runtime": {**self.metadata["runtime"], "attributes": dict(attributes)}}
        consolidated = {**self.document["consolidated_metadata"], "metadata": metadata}
        return Root({**self.document, "consolidated_metadata": consolidated})

    def encode(self) -> bytes:
        """The file's bytes: one text per document, with a digest of everything else in it."""
        # Compact, and encoded once: the digest takes the place of a row of dashes.
        attributes = {**self.attributes, "root_digest": _NO_DIGEST}
        text = _text({**self.document, "attributes": attributes})
        own = f'"root_digest":"{_NO_DIGEST}"'.encode()
        return text.replace(own, f'"root_digest":"{digests.sha256(text)}"'.encode(), 1)


COMMITTED = ("candidate", "stage_candidate", "block_candidate")
"""Dimensions whose length in the root is that of what is committed."""


def runtime_text(root: Root) -> bytes:
    """The bytes of the group `runtime`'s own metadata, which say what the root says of it."""
    document = root.metadata["runtime"]
    return _text({name: value for name, value in document.items() if name != "consolidated_metadata"})


def _text(document: Mapping[str, Any]) -> bytes:
    return json.dumps(document, separators=(",", ":"), sort_keys=True, allow_nan=False).encode()
