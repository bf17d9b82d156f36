"""Owns the empty hierarchy: every array of a store with dimensions, type, unit, chunks and codecs, built in memory."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
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
    SCHEMA_VERSION,
    WALL,
    WORDS,
    Constant,
    Field,
)
from softclose_store.schema.layout import CANDIDATES, CASE_PREFIX, POPULATION, RUNTIME, Layout, StageLayout
from softclose_store.schema.root import (
    BACKUP_KEY,
    HYPERPARAMETERS,
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

CANDIDATE_CHUNK = 4_096
"""Rows in one chunk of what is known of every candidate beforehand: always as many, so that an extension, which has
more candidates, changes nothing of what is read of those that there were."""

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
    f"{CANDIDATES}/{s.name}": s
    for s in (
        _spec(
            "table",
            "surrogate",
            "candidate hyperparameter",
            "f8",
            "see hyperparameter_unit",
            "what the proposal's surrogate believed",
        ),
        _spec("table", "words", "candidate word", "str", "1", "what is said of a candidate in words"),
        _spec(
            "table",
            "wall_times",
            "candidate wall_time",
            "f8",
            "see wall_time_unit",
            "timings, which two runs do not share",
        ),
        _spec("table", "records", "candidate field", "f8", "see field_unit", "waveform, objective, intervals …"),
        _spec("table", "digests", "candidate digest", "u8", "1", "xxh3 of what is stored of a candidate; 0: nothing"),
    )
}
"""Tables, one row a candidate, by their names from the root, in the order in which a commit writes them."""

_EACH = "candidate switch"
_PLAIN = (
    _spec("block", "response", f"{_EACH} quantity", "f8", "see quantity_unit", "what is kept of a switch"),
    _spec("block", "impact", f"{_EACH} event impact_quantity", "f8", "see impact_quantity_unit", "the first impacts"),
    _spec("block", "x", f"{_EACH} time", "f4", "µm", "travel x(t)"),
    _spec("block", "v", f"{_EACH} time", "f4", "µm/µs", "velocity v(t)"),
    _spec("block", "mode_x", f"{_EACH} mode time", "f4", "µm", "part of each further mode in the travel"),
    _spec("block", "mode_v", f"{_EACH} mode time", "f4", "µm/µs", "part of each further mode in the velocity"),
)
BLOCK_SPECS = {s.name: s for s in _PLAIN} | {
    f"{CASE_PREFIX}{s.name}": replace(
        s,
        name=f"{CASE_PREFIX}{s.name}",
        dims=("candidate", "switch", "case", *s.dims[2:]),
        long_name=f"{s.long_name}, in each case",
    )
    for s in _PLAIN
}
"""Arrays of a stage that workers write, one chunk a block. `mode_…` are there where switches have several modes,
`case_…` where they are simulated in several cases: those without prefix hold what counts of a switch."""

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
    grows: bool = False
    """Whether an extension adds to it."""


def static_arrays(layout: Layout, population: Mapping[str, NDArray[np.float64]] | None) -> dict[str, Static]:
    """Every static array of a store, by its name from the root.

    population: None for arrays of the right types and sizes, of which those of a campaign's own sizes take no memory.
    """
    is_filled = population is not None
    columns = population or dict.fromkeys([c.name for c in layout.columns], _blank(np.float64(0.0), layout.n_switches))
    whole = {
        c.name: Static(dims=("switch",), values=columns[c.name], unit=c.unit, long_name=c.long_name)
        for c in layout.columns
    } | {"switch": _count("switch", 0, layout.n_switches, is_filled)}
    tables = {
        **_labels("field", layout.fields, "records"),
        "word": _names("word", WORDS, "columns of words"),
        "digest": _texts("digest", DIGESTS, "what a digest is of"),
        **{name: s for name, s in _labels("wall_time", WALL, "wall_times").items() if name != "wall_time_long_name"},
        "candidate": replace(_count("candidate", 0, layout.n_candidates, is_filled), grows=True),
        "stage": _of_stages(layout, is_filled, "name", "stage of the candidate: its group"),
        "engine": _of_stages(layout, is_filled, "engine", "engine of that stage"),
    }
    arrays = {f"{POPULATION}/{name}": static for name, static in whole.items()}
    arrays |= {f"{CANDIDATES}/{name}": static for name, static in tables.items()}
    for stage in layout.stages:
        arrays |= {f"{stage.name}/{name}": s for name, s in _stage_statics(layout, stage, is_filled).items()}
    return arrays


def growing_arrays(layout: Layout) -> frozenset[str]:
    """Static arrays to which an extension adds: what they say of the candidates before it stays."""
    return frozenset(name for name, static in static_arrays(layout, None).items() if static.grows)


def _stage_statics(layout: Layout, stage: StageLayout, is_filled: bool) -> dict[str, Static]:
    """The coordinates of a stage: its switches and candidates are counted as in the whole campaign."""
    arrays = {
        "candidate": _count("candidate", layout.first(stage.name), stage.n_candidates, is_filled),
        "switch": _count("switch", 0, stage.n_switches, is_filled),
        "quantity": _names("quantity", layout.quantities, "columns of response"),
        "quantity_unit": _texts("quantity", [q.unit for q in layout.quantities], "units of the columns of response"),
        "marker": _texts("marker", layout.marker_names, "what a block's digest is of"),
    }
    if layout.max_impacts:
        units = [q.unit for q in IMPACT_QUANTITIES]
        arrays["impact_quantity"] = _names("impact_quantity", IMPACT_QUANTITIES, "columns of impact")
        arrays["impact_quantity_unit"] = _texts("impact_quantity", units, "units of the columns of impact")
    if layout.times_us.size:
        arrays["time"] = Static(
            dims=("time",), values=layout.times_us, unit="µs", long_name="time since the first pulse starts"
        )
        if layout.n_modes > 1:
            arrays["mode"] = _count("mode", 2, layout.n_modes - 1, True)
    if layout.n_cases > 1:
        arrays["case"] = _count("case", 0, layout.n_cases, True)
        arrays |= {
            c.name: Static(dims=("case",), values=np.array(c.values, dtype=float), unit=c.unit, long_name=c.long_name)
            for c in layout.cases
        }
    return arrays


def _blank(value: Any, n: int) -> NDArray[Any]:
    """n times one value that is there once: the sizes of a layout may come out of a store that somebody made up."""
    return np.broadcast_to(value, n)


def _count(dim: str, first: int, n: int, is_filled: bool) -> Static:
    values = np.arange(first, first + n) if is_filled else _blank(np.int64(0), n)
    return Static(dims=(dim,), values=values, long_name=f"index of the {dim}")


def _of_stages(layout: Layout, is_filled: bool, attribute: str, long_name: str) -> Static:
    """A text of its stage for each candidate."""
    if is_filled:
        values = layout.of_stages(attribute)
    else:
        values = _blank(np.array("", dtype=np.dtypes.StringDType()), layout.n_candidates)
    return Static(dims=("candidate",), values=values, long_name=long_name, grows=True)


def _labels(dim: str, fields: Sequence[Field], table: str) -> dict[str, Static]:
    """Names, units and meanings of the columns of a table."""
    return {
        dim: _names(dim, fields, f"columns of {table}"),
        f"{dim}_unit": _texts(dim, [f.unit for f in fields], f"units of the columns of {table}"),
        f"{dim}_long_name": _texts(dim, [f.long_name for f in fields], f"meanings of the columns of {table}"),
    }


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
    constants: Mapping[str, Constant],
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
        "constants": {
            name: {"value": c.value, "units": c.unit, "long_name": c.long_name} for name, c in constants.items()
        },
        "layout": layout.to_dict(),
        "durable": durable,
        "static_digests": {name: digests.array_sha256(static.values) for name, static in statics.items()},
        "metadata_digest": metadata_digest(contents),
    }
    root = Root(document).with_runtime(runtime)
    contents[ROOT_KEY] = contents[BACKUP_KEY] = root.committed(0, 0, ()).encode()
    contents[RUNTIME_KEY] = runtime_text(root)
    return contents


def constants_of(root: Root) -> dict[str, Constant]:
    """The constants that a root says."""
    said = root.attributes["constants"]
    return {name: Constant(c["value"], c["units"], c["long_name"]) for name, c in said.items()}


def schema_of(layout: Layout) -> dict[str, bytes]:
    """The metadata of every array and group of a store of this layout, the root's without attributes: key -> bytes.

    Nothing is allocated by the layout's sizes: they may come out of a store that somebody made up.
    """
    return dict(_schema(digests.canonical_json(layout.to_dict())))


@lru_cache(maxsize=16)
def _schema(sizes: str) -> Mapping[str, bytes]:
    data = json.loads(sizes)
    layout = Layout.from_dict(data, np.arange(float(data["n_times"])))
    buffers: dict[str, Buffer] = {}
    memory = MemoryStore(buffers)

    async def create() -> None:
        group = await create_group(store=memory)
        for name in (CANDIDATES, POPULATION, RUNTIME):
            await group.create_group(name)
        for stage in layout.stages:
            attributes = {
                "first_candidate": layout.first(stage.name),
                "n_candidates": stage.n_candidates,
                "engine": stage.engine,
            }
            await group.create_group(stage.name, attributes=attributes)
        for name, static in {**static_arrays(layout, None), **_no_hyperparameters()}.items():
            await group.create_array(name, **_static_options(static))
        for name, spec in TABLES.items():
            await group.create_array(name, **_table_options(layout, spec))
        for stage in layout.stages:
            for spec in stage_specs(layout):
                await group.create_array(f"{stage.name}/{spec.name}", **_stage_options(layout, stage, spec))
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
        for name, static in {**statics, **_no_hyperparameters()}.items():
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
        "chunks": tuple(CANDIDATE_CHUNK if static.grows else max(1, min(n, STATIC_CHUNK)) for n in static.values.shape),
        "dtype": "str" if is_text else static.values.dtype,
        "dimension_names": static.dims,
        "compressors": [text_codec() if is_text else fast_codec(), Crc32cCodec()],
        "fill_value": "" if is_text else 0,
        "attributes": {"units": static.unit, "long_name": static.long_name},
        "chunk_key_encoding": KEYS,
        "config": {"write_empty_chunks": True},
    }


HYPERPARAMETER = f"{CANDIDATES}/{HYPERPARAMETERS}"
"""Coordinate of `surrogate`: names of what surrogates said so far, then "". The root says them too, and is right; in
the root it is as long as there are names."""
HYPERPARAMETER_UNIT = f"{HYPERPARAMETER}_unit"
"""Their units."""


def _no_hyperparameters() -> dict[str, Static]:
    blank = [""] * N_SURROGATE
    meaning = "columns of surrogate, in the order in which they were first used"
    return {
        HYPERPARAMETER: _texts(HYPERPARAMETERS, blank, meaning),
        HYPERPARAMETER_UNIT: _texts(HYPERPARAMETERS, blank, "units of the columns of surrogate"),
    }


def _table_options(layout: Layout, spec: ArraySpec) -> dict[str, Any]:
    columns = {"field": len(layout.fields), "word": len(WORDS), "wall_time": len(WALL)}
    columns |= {"hyperparameter": N_SURROGATE, "digest": len(DIGESTS)}
    n = columns[spec.dims[1]]
    attributes: dict[str, Any] = {"units": spec.unit, "long_name": spec.long_name}
    if spec.name in _TOLD:
        attributes["coordinates"] = " ".join(_TOLD[spec.name])
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


_TOLD = {
    "wall_times": ("wall_time_unit",),
    "response": ("quantity_unit",),
    "impact": ("impact_quantity_unit",),
}
"""Coordinates of text that an array has beside the names of its columns, which are the same in every campaign. What
differs from one campaign to another (stages; units of fields and of a surrogate's quantities) is an array beside it and
no coordinate of it: xarray cannot fill a coordinate of text, so that two campaigns would not join."""


def _stage_options(layout: Layout, stage: StageLayout, spec: ArraySpec) -> dict[str, Any]:
    attributes: dict[str, Any] = {"units": spec.unit, "long_name": spec.long_name}
    shards: tuple[int, ...] | None = None
    compressors: list[Any]
    if spec.role == "marker":
        n = len(layout.marker_names)
        shape: tuple[int, ...] = (stage.n_block_candidates, stage.n_block_switches, n)
        chunks: tuple[int, ...] = (1, 1, n)
        compressors, fill = [Crc32cCodec()], 0.0
    else:
        rest, _ = layout.block_arrays[spec.name]
        row = 8 * len(layout.quantities)
        shape = (stage.n_candidates, stage.n_switches, *rest)
        shards = (stage.block_candidates, stage.block_switches, *rest)
        chunks = (*stage.inner, *rest)
        kind = spec.name.removeprefix(CASE_PREFIX)
        codec = sparse_codec() if kind == "impact" else fast_codec(row if kind == "response" else None)
        compressors, fill = [codec, Crc32cCodec()], np.nan
        labels = [*_TOLD.get(kind, ()), *((c.name for c in layout.cases) if kind != spec.name else ())]
        if labels:
            attributes["coordinates"] = " ".join(labels)
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
