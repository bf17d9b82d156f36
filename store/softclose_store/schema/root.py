"""Owns the root `zarr.json`: identity, layout and the commit marker.

The root carries consolidated metadata in which the `candidate` length of every table is the number of committed
candidates, and that of every stage's arrays the stage's part of it. One atomic replacement of this file commits a wave:
readers of consolidated metadata (zarr, xarray, ours) see committed candidates only, while writers open the arrays
themselves at full capacity. Result groups are listed there too, so that trees show them; our own reader asks their
files.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from softclose_store.disk.names import OWN_FOLDER
from softclose_store.schema import digests
from softclose_store.schema.layout import CANDIDATES, OWN_GROUPS

ROOT_KEY = "zarr.json"
KIND = "softclose-campaign"
SCHEMA_ATTRIBUTE = "softclose_schema"
BACKUP_KEY = f"{OWN_FOLDER}/root.json"
"""The root as created, nothing committed: what a damaged root is rebuilt from."""
EXTENSION_KEY = f"{OWN_FOLDER}/extension.json"
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
        """Consolidated metadata of the campaign itself: array or group name -> its document."""
        own = self._own_groups
        return {name: entry for name, entry in self._consolidated.items() if name.partition("/")[0] in own}

    @property
    def listed(self) -> dict[str, dict[str, Any]]:
        """Consolidated metadata of result groups, their arrays, and the groups that they lie in."""
        own = self._own_groups
        return {name: entry for name, entry in self._consolidated.items() if name.partition("/")[0] not in own}

    @property
    def _consolidated(self) -> dict[str, dict[str, Any]]:
        metadata: dict[str, dict[str, Any]] = self.document["consolidated_metadata"]["metadata"]
        return metadata

    def is_own(self, name: str) -> bool:
        """Whether a name is in one of the campaign's own groups."""
        return name.partition("/")[0] in self._own_groups

    @property
    def _own_groups(self) -> frozenset[str]:
        return frozenset(OWN_GROUPS).union(stage["name"] for stage in self.attributes["layout"]["stages"])

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
        lengths = {CANDIDATES: n_candidates}
        steps = {}
        first = 0
        for stage in self.attributes["layout"]["stages"]:
            lengths[stage["name"]] = min(max(n_candidates - first, 0), stage["n_candidates"])
            steps[stage["name"]] = stage["block_candidates"]
            first += stage["n_candidates"]
        metadata = self.listed
        for name, entry in self.metadata.items():
            group = name.rpartition("/")[0]
            if group in lengths:
                sizes = {CANDIDATE: lengths[group], HYPERPARAMETERS: len(hyperparameters)}
                sizes["block_candidate"] = -(-lengths[group] // steps.get(group, 1))
                dims = zip(entry["dimension_names"], entry["shape"], strict=True)
                entry = {**entry, "shape": [sizes.get(dim, n) for dim, n in dims]}
            metadata[name] = entry
        attributes = {
            **self.attributes,
            "n_committed": n_candidates,
            "n_waves": n_waves,
            "hyperparameters": list(hyperparameters),
        }
        return Root({**self.document, "attributes": attributes})._with_metadata(metadata)

    def _with_metadata(self, metadata: Mapping[str, Any]) -> Root:
        consolidated = {**self.document["consolidated_metadata"], "metadata": dict(metadata)}
        return Root({**self.document, "consolidated_metadata": consolidated})

    def listing(self, groups: Mapping[str, Mapping[str, Any]]) -> Root:
        """The same root that lists these metadata of result groups, and no others."""
        return self._with_metadata({**self.metadata, **groups})

    def created(self) -> Root:
        """The root as the creation wrote it: nothing committed, no run noted, no result group."""
        attributes = self.metadata["runtime"]["attributes"]
        runtime = {name: value for name, value in attributes.items() if name != "runs"}
        return self.listing({}).committed(0, 0, ()).with_runtime(runtime)

    def noted(self, run: Mapping[str, Any]) -> Root:
        """The same root with one more run in the attribute `runs` of the group `runtime`."""
        runtime = self.metadata["runtime"]
        attributes = {**runtime["attributes"], "runs": [*runtime["attributes"].get("runs", []), dict(run)]}
        return self.with_runtime(attributes)

    def amended(self, more: Mapping[str, Any]) -> Root:
        """The same root with more in what is said of its latest run; as it is where there was none."""
        attributes = self.metadata["runtime"]["attributes"]
        *earlier, latest = attributes.get("runs") or [None]
        if latest is None:
            return self
        return self.with_runtime({**attributes, "runs": [*earlier, {**latest, **more}]})

    def with_runtime(self, attributes: Mapping[str, Any]) -> Root:
        """The same root with other attributes of the group `runtime`."""
        entry = {**self.metadata["runtime"], "attributes": dict(attributes)}
        return self._with_metadata({**self._consolidated, "runtime": entry})

    def encode(self) -> bytes:
        """The file's bytes: one text per document, with a digest of everything else in it."""
        # Compact, and encoded once: the digest takes the place of a row of dashes.
        attributes = {**self.attributes, "root_digest": _NO_DIGEST}
        text = _text({**self.document, "attributes": attributes})
        own = f'"root_digest":"{_NO_DIGEST}"'.encode()
        return text.replace(own, f'"root_digest":"{digests.sha256(text)}"'.encode(), 1)


CANDIDATE, HYPERPARAMETERS = "candidate", "hyperparameter"
"""Dimensions whose length in the root is that of what is committed; so is that of blocks along candidates."""


def runtime_text(root: Root) -> bytes:
    """The bytes of the group `runtime`'s own metadata, which say what the root says of it."""
    document = root.metadata["runtime"]
    return _text({name: value for name, value in document.items() if name != "consolidated_metadata"})


def _text(document: Mapping[str, Any]) -> bytes:
    return json.dumps(document, separators=(",", ":"), sort_keys=True, allow_nan=False).encode()
