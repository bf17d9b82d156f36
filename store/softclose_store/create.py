"""Owns the creation of a store: every array at full capacity, appearing at once or not at all."""

from __future__ import annotations

import json
import os
import shutil
import socket
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray
from zarr.abc.buffer import Buffer
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.storage import MemoryStore

from softclose_store import digests, faults
from softclose_store.errors import (
    DamageError,
    LayoutError,
    OtherConfigurationError,
    StoreError,
    StoreExistsError,
    StoreMissingError,
)
from softclose_store.files import StorePath, local_path, normalised, open_files, sync_directory, write_key
from softclose_store.layout import (
    CANDIDATE_ARRAYS,
    CHUNK_KEY_SEPARATOR,
    MARKER,
    PARAMETERS,
    POPULATION,
    SCHEMA_VERSION,
    ArraySpec,
    Layout,
)
from softclose_store.processes import process_is_alive
from softclose_store.root import (
    BACKUP_KEY,
    KIND,
    ROOT_KEY,
    RUNTIME_KEY,
    SCHEMA_ATTRIBUTE,
    Root,
    read_root,
    runtime_text,
)

KEYS: Any = {"name": "default", "separator": CHUNK_KEY_SEPARATOR}
"""Flat file names `c.3.0.0`: with the default `c/3/0/0` every chunk makes up to three folders an array, which cost more
than its small files."""

STATIC_CHUNK = 65_536
"""Rows in one chunk of a population array."""


def fast_codec() -> BloscCodec:
    """lz4 after byte shuffling, in blocks that fit a cache: of those measured the fast enough one (docs/adr/020)."""
    return BloscCodec(cname="lz4", clevel=1, shuffle="shuffle", blocksize=65_536)


def create_campaign(
    path: StorePath,
    *,
    layout: Layout,
    config: Mapping[str, Any],
    population: Mapping[str, ArrayLike],
    runtime: Mapping[str, Any] | None = None,
    fingerprint: str | None = None,
    durable: bool = False,
    exist_ok: bool = False,
) -> None:
    """Create the store of a campaign, with nothing committed. It appears at `path` at once or not at all.

    config: plain JSON values; its sha256 (canonical JSON) is the campaign's fingerprint, checked against `fingerprint`
    where given. population: (n_switches,) float64 arrays D, G, E, T, K, M.
    exist_ok: a store of this very configuration is left as it is.
    Raises StoreExistsError or OtherConfigurationError (naming what differs), LayoutError, OSError.
    """
    try:
        config = json.loads(digests.canonical_json(config))
    except (TypeError, ValueError) as e:
        raise StoreError(f"the configuration is not made of plain finite JSON values: {e}") from e
    identity = digests.fingerprint_of(config)
    if fingerprint is not None and fingerprint != identity:
        raise StoreError(f"the fingerprint given is {fingerprint}, but the configuration's is {identity}")
    if _same_campaign_exists(path, config, identity, exist_ok=exist_ok):
        return
    columns = population_columns(population, layout.n_switches)
    target = local_path(path)
    hierarchy = build_hierarchy(layout, config, identity, columns, dict(runtime or {}), durable)
    if target is None:
        files = open_files(path, read_only=False)
        for key in sorted(hierarchy, key=lambda key: (key == ROOT_KEY, key)):
            if key == ROOT_KEY:
                faults.point("inside-creation")
            write_key(files, key, hierarchy[key])
        return
    _appear(target.absolute(), hierarchy, durable)


def population_columns(population: Mapping[str, ArrayLike], n: int) -> dict[str, NDArray[np.float64]]:
    """The columns of a population as they are stored; raises LayoutError."""
    if set(population) != set(POPULATION):
        raise LayoutError(f"the population has columns {sorted(population)}; it needs {sorted(POPULATION)}")
    columns = {name: np.ascontiguousarray(population[name], dtype=np.float64) for name in POPULATION}
    for name, column in columns.items():
        if column.shape != (n,) or not np.all(np.isfinite(column)):
            raise LayoutError(f"population column {name} has shape {column.shape}; it must be ({n},), all finite")
    return columns


def build_hierarchy(
    layout: Layout,
    config: Mapping[str, Any],
    fingerprint: str,
    population: Mapping[str, NDArray[np.float64]],
    runtime: Mapping[str, Any],
    durable: bool,
) -> dict[str, bytes]:
    """The whole empty hierarchy in memory: key -> bytes."""
    buffers: dict[str, Buffer] = {}
    memory = MemoryStore(buffers)
    group = zarr.create_group(memory)
    static = dict(_static_arrays(layout, population))
    for name, (dims, values, unit, long_name) in static.items():
        array = group.create_array(
            name,
            shape=values.shape,
            chunks=tuple(max(1, min(n, STATIC_CHUNK)) for n in values.shape),
            dtype="str" if values.dtype.kind == "T" else values.dtype,
            dimension_names=dims,
            compressors=[fast_codec(), Crc32cCodec()] if values.dtype.kind == "f" else [Crc32cCodec()],
            fill_value="" if values.dtype.kind == "T" else 0,
            attributes={"units": unit, "long_name": long_name},
            chunk_key_encoding=KEYS,
        )
        array[...] = values
    for spec in (*layout.switch_arrays, *CANDIDATE_ARRAYS, MARKER):
        _create_array(group, layout, spec)
    group.create_group("runtime", attributes=dict(runtime))
    with warnings.catch_warnings():
        # The Zarr v3 specification does not cover consolidated metadata yet; zarr says so wherever it writes them.
        warnings.filterwarnings("ignore", message="Consolidated metadata is currently not part")
        zarr.consolidate_metadata(memory)
    contents = {key: value.to_bytes() for key, value in buffers.items()}
    root = Root(json.loads(contents[ROOT_KEY]))
    root.attributes.update(
        {
            "kind": KIND,
            SCHEMA_ATTRIBUTE: SCHEMA_VERSION,
            "fingerprint": fingerprint,
            "config": dict(config),
            "layout": layout.to_dict(),
            "durable": durable,
            "static_digests": {name: digests.array_sha256(values) for name, (_, values, _, _) in static.items()},
            "metadata_digest": metadata_digest(contents),
        }
    )
    contents[ROOT_KEY] = contents[BACKUP_KEY] = root.committed(0).encode()
    contents[RUNTIME_KEY] = runtime_text(root)
    return contents


def metadata_digest(contents: Mapping[str, bytes]) -> str:
    """sha256 over the metadata documents of all arrays of the schema: key -> bytes, others are ignored."""
    keys = sorted(k for k in contents if k.count("/") == 1 and k.endswith("/zarr.json") and k != "runtime/zarr.json")
    return digests.sha256(b"".join(k.encode() + b"\0" + contents[k] + b"\0" for k in keys))


def _static_arrays(
    layout: Layout, population: Mapping[str, NDArray[np.float64]]
) -> list[tuple[str, tuple[tuple[str, ...], NDArray[Any], str, str]]]:
    text = np.dtypes.StringDType()
    arrays: list[tuple[str, tuple[tuple[str, ...], NDArray[Any], str, str]]] = [
        ("parameter", (("parameter",), np.array(PARAMETERS, dtype=text), "1", "columns of a waveform: µs, µs, µs, V")),
        ("limit", (("limit",), np.array(layout.limits_cm_s), "cm/s", "contact speed that must not be exceeded")),
        ("array", (("array",), np.array(layout.marker_names, dtype=text), "1", "what a chunk digest is of")),
    ]
    if layout.times_us.size:
        arrays.append(("time", (("time",), layout.times_us, "µs", "time since the first pulse starts")))
    for name, values in population.items():
        long_name, unit = POPULATION[name]
        arrays.append((name, (("switch",), values, unit, long_name)))
    return arrays


def _create_array(group: zarr.Group, layout: Layout, spec: ArraySpec) -> None:
    shape = layout.shape(spec)
    attributes: dict[str, Any] = {"units": spec.unit, "long_name": spec.long_name}
    if spec.role == "switch":
        rest = shape[2:]
        shards = (1, layout.chunk_switches, *rest)
        chunks = (1, layout.inner_switches if rest else layout.chunk_switches, *rest)
        # Scalars cost 40 bytes a switch at most: compressing them would save little and cost time.
        compressors = [fast_codec(), Crc32cCodec()] if rest else [Crc32cCodec()]
        group.create_array(
            spec.name,
            shape=shape,
            chunks=chunks,
            shards=None if chunks == shards else shards,
            dtype=spec.dtype,
            compressors=compressors,
            fill_value=spec.fill,
            dimension_names=spec.dims,
            attributes=attributes,
            chunk_key_encoding=KEYS,
        )
        return
    chunks = (1, 1, *shape[2:]) if spec.role == "marker" else (layout.record_chunk, *shape[1:])
    group.create_array(
        spec.name,
        shape=shape,
        chunks=chunks,
        dtype=spec.dtype,
        compressors=[Crc32cCodec()],
        fill_value=spec.fill,
        dimension_names=spec.dims,
        attributes=attributes,
        chunk_key_encoding=KEYS,
    )


def _appear(target: Path, hierarchy: Mapping[str, bytes], durable: bool) -> None:
    """Write the hierarchy into a sibling of the target and rename it: there is never half a store at the target."""
    _remove_abandoned(target)
    sibling = target.with_name(f"{target.name}.creating-{socket.gethostname()}-{os.getpid()}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(sibling, ignore_errors=True)
        files = open_files(sibling, read_only=False, durable=durable)
        for key in sorted(hierarchy, key=lambda key: (key == ROOT_KEY, key)):
            if key == ROOT_KEY:
                faults.point("inside-creation")
            write_key(files, key, hierarchy[key])
        os.rename(sibling, target)  # replaces an empty folder, refuses any other
        if durable:
            sync_directory(target.parent)
    except OSError as e:
        shutil.rmtree(sibling, ignore_errors=True)
        raise StoreError(
            f"cannot create a store at {target}: {e.strerror or e}; give a path in a folder that you can write to"
        ) from e


def _remove_abandoned(target: Path) -> None:
    """Remove what creations left behind whose process on this host is gone."""
    prefix = f"{target.name}.creating-{socket.gethostname()}-"
    if not target.parent.is_dir():
        return
    for sibling in target.parent.iterdir():
        pid = sibling.name.removeprefix(prefix)
        if sibling.name.startswith(prefix) and pid.isdigit() and not process_is_alive(int(pid)):
            shutil.rmtree(sibling, ignore_errors=True)


def _same_campaign_exists(path: StorePath, config: Mapping[str, Any], fingerprint: str, *, exist_ok: bool) -> bool:
    """True where this very campaign is there and that is welcome; False where nothing is there."""
    state = store_state(path)
    where = normalised(path)
    if state.kind in ("absent", "unfinished"):
        return False
    if state.kind == "foreign":
        raise StoreExistsError(f"{where} exists and is no Softclose store; give a path that does not exist yet")
    if state.kind == "damaged":
        raise DamageError(f"{where} holds a damaged store ({state.problem}); `softclose verify` says more")
    if state.fingerprint != fingerprint:
        changes = differences(state.config, config)
        raise OtherConfigurationError(
            f"{where} holds a campaign of another configuration; it differs in\n"
            + "\n".join(f"  {change}" for change in changes)
            + "\ngive another path, or undo these changes and resume it"
        )
    if exist_ok:
        return True
    advice = "it is finished: read it" if state.finished else f"continue it with `softclose resume {where}`"
    done = f"{state.n_committed} of {state.budget} candidates"
    raise StoreExistsError(f"{where} holds this very campaign, {done}: {advice}")


@dataclass(frozen=True, slots=True, kw_only=True)
class StoreState:
    """What a path holds, found without opening it for work."""

    kind: Literal["absent", "unfinished", "campaign", "foreign", "damaged"]
    """absent: nothing, or an empty folder; unfinished: a creation that was interrupted; foreign: something else."""
    n_committed: int = 0
    """Committed candidates."""
    budget: int = 0
    """Candidates of the whole campaign."""
    fingerprint: str = ""
    """Identity of the campaign."""
    config: Mapping[str, Any]
    """Its configuration; empty where there is none."""
    problem: str = ""
    """What is wrong, where something is."""

    @property
    def finished(self) -> bool:
        """True where every candidate is committed."""
        return self.kind == "campaign" and self.n_committed == self.budget


def store_state(path: StorePath) -> StoreState:
    """Say what is at a path. Raises SchemaError for a store of a newer schema version."""
    where = normalised(path)
    local = local_path(path)
    if local is not None:
        if not local.exists():
            return StoreState(kind="absent", config={})
        if not local.is_dir():
            return StoreState(kind="foreign", config={}, problem="a file")
        if not any(local.iterdir()):
            return StoreState(kind="absent", config={})
    files = open_files(path, read_only=True)
    try:
        root = read_root(files, where)
    except DamageError as e:
        return StoreState(kind="damaged", config={}, problem=str(e))
    except StoreMissingError as e:
        if "unfinished" in str(e):
            return StoreState(kind="unfinished", config={}, problem=str(e))
        if local is None and "no campaign" in str(e):
            return StoreState(kind="absent", config={})
        return StoreState(kind="foreign", config={}, problem=str(e))
    attributes = root.attributes
    return StoreState(
        kind="campaign",
        n_committed=root.n_committed,
        budget=int(attributes["layout"]["n_candidates"]),
        fingerprint=root.fingerprint,
        config=attributes["config"],
    )


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Dotted keys in which two configurations differ: `campaign.seed: the store has 1, this configuration 2`."""
    changes = []
    flat_old, flat_new = _flat(old), _flat(new)
    for key in sorted(set(flat_old) | set(flat_new)):
        a, b = flat_old.get(key, "nothing"), flat_new.get(key, "nothing")
        if a != b:
            changes.append(f"{key}: the store has {a}, this configuration {b}")
    return changes


def _flat(data: Any, prefix: str = "") -> dict[str, str]:
    if isinstance(data, Mapping) and data:
        return {k: v for key, value in data.items() for k, v in _flat(value, f"{prefix}{key}.").items()}
    return {prefix.rstrip("."): json.dumps(data, sort_keys=True)}
