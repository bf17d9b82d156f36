"""Owns the schema of a store: its version, and every array with dimensions, type, unit and chunks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from softclose_store.errors import LayoutError, SchemaError

SCHEMA_VERSION = 1
"""Version of this schema; a store with a newer one is refused by name."""

MAX_CHUNKS = 256
"""Most chunks a candidate may have: bounds the number of files per candidate, whatever the number of switches."""

MAX_INNER = 8192
"""Most switches in one inner Zarr chunk, the unit of partial reads: 33 MB of x at 1,001 points, 15 ms to decode. Chunks
up to this size are no shards: cutting them up costs zarr a copy and 0.1 ms of Python each (docs/adr/020)."""

MIN_INNER = 128
"""Fewest switches in an inner chunk of a sharded array: every inner chunk costs 0.1 ms of Python."""

CHUNK_KEY_SEPARATOR = "."
"""Between the indices in a chunk's key."""

RECORD_CHUNK = 128
"""Most candidates in one chunk of a per-candidate array: few files, and a commit rewrites only the last of each."""

N_SURROGATE = 32
"""Most quantities a proposal may say about its surrogate."""

PARAMETERS = ("start_us", "rise_us", "peak_us", "volts")
"""Coordinate of the dimension `parameter`: the columns of a waveform."""

POPULATION = {
    "D": ("travel to contact", "µm"),
    "G": ("electrostatic gap", "µm"),
    "E": ("Young's modulus", "GPa"),
    "T": ("thickness", "µm"),
    "K": ("stiffness", "N/m"),
    "M": ("effective mass", "µg"),
}
"""Per-switch properties: name -> (meaning, unit)."""

INTERVALS = ("wald", "wilson", "clopper_pearson")
"""Intervals kept for each probability."""

Role = Literal["switch", "proposal", "record", "wall", "digest", "marker", "static"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArraySpec:
    """One array of the schema."""

    name: str
    """Name in the store."""
    dims: tuple[str, ...]
    """Dimension names."""
    dtype: str
    """numpy type, or "str" for text."""
    unit: str
    """Unit; "1" where there is none."""
    long_name: str
    """What it is, in words."""
    role: Role
    """Who writes it: workers (switch, marker), the driver (proposal, record, wall, digest), the creation (static)."""

    @property
    def fill(self) -> Any:
        """What an element holds that was never written."""
        if self.dtype == "str":
            return ""
        kind = np.dtype(self.dtype).kind
        return {"f": math.nan, "i": -1, "b": False, "u": 0}[kind]

    def empty(self, shape: Sequence[int]) -> NDArray[Any]:
        """Array of this type full of the fill value."""
        dtype = np.dtypes.StringDType() if self.dtype == "str" else np.dtype(self.dtype)
        return np.full(tuple(shape), self.fill, dtype=dtype)


def _spec(role: Role, name: str, dims: str, dtype: str, unit: str, long_name: str) -> ArraySpec:
    return ArraySpec(name=name, dims=tuple(dims.split()), dtype=dtype, unit=unit, long_name=long_name, role=role)


def _switch_specs() -> list[ArraySpec]:
    cs, csi, cst = "candidate switch", "candidate switch impact", "candidate switch time"
    return [
        _spec("switch", "max_contact_speed", cs, "f8", "µm/µs", "largest contact speed V, Eq. 7; NaN: never touched"),
        _spec("switch", "first_contact", cs, "f8", "µs", "instant of the first contact; inf: never"),
        _spec("switch", "settling", cs, "f8", "µs", "instant from which it is held to the horizon; inf: never"),
        _spec("switch", "n_impacts", cs, "i4", "1", "number of impacts"),
        _spec("switch", "final_x", cs, "f8", "µm", "travel at the horizon"),
        _spec("switch", "final_v", cs, "f8", "µm/µs", "velocity at the horizon"),
        _spec("switch", "closed", cs, "bool", "1", "held in contact at the horizon"),
        _spec("switch", "status", cs, "i1", "1", "outcome of the integration; 0: ok, -1: not simulated"),
        _spec("switch", "impact_time", csi, "f8", "µs", "instants of the first impacts; NaN beyond the last"),
        _spec("switch", "impact_speed", csi, "f8", "µm/µs", "speeds just before the first impacts"),
        _spec("switch", "x", cst, "f4", "µm", "travel x(t)"),
        _spec("switch", "v", cst, "f4", "µm/µs", "velocity v(t)"),
    ]


def _interval_specs(name: str, dims: str, meaning: str) -> list[ArraySpec]:
    return [
        _spec("record", f"{name}_{kind}_{end}", dims, "f8", "1", f"{end} end of the {kind} interval of {meaning}")
        for kind in INTERVALS
        for end in ("lower", "upper")
    ]


def _candidate_specs() -> list[ArraySpec]:
    c, cl = "candidate", "candidate limit"
    specs = [
        _spec(
            "proposal",
            "waveform",
            "candidate pulse parameter",
            "f8",
            "µs or V",
            "pulses of the waveform; a peak of inf holds, rows of NaN are absent",
        ),
        _spec("proposal", "n_switches", c, "i4", "1", "switches that the candidate is evaluated on"),
        _spec("proposal", "origin", c, "str", "1", "who proposed the candidate"),
        _spec("proposal", "note", c, "str", "1", "why something unusual was done"),
        _spec(
            "proposal",
            "surrogate",
            "candidate hyperparameter",
            "f8",
            "1",
            "what the surrogate believed; named by surrogate_name",
        ),
        _spec("proposal", "surrogate_name", "candidate hyperparameter", "str", "1", "names of the surrogate's values"),
        _spec("digest", "proposal_digest", c, "u8", "1", "xxh3 of the proposal; 0: not proposed"),
        _spec("record", "failed", c, "bool", "1", "no usable result exists"),
        _spec("record", "failure", c, "str", "1", "why the candidate failed"),
        _spec("record", "feasible", c, "bool", "1", "p_nc is at most its limit (always true in the penalty form)"),
        _spec("record", "n_failed_switches", c, "i4", "1", "switches that could not be integrated"),
    ]
    for name, meaning in (
        ("g", "objective g, Eq. 10"),
        ("v_u", "upper velocity, Eqs. 8-9"),
        ("mean", "mean contact speed"),
    ):
        specs += [
            _spec("record", f"{name}_cm_s", c, "f8", "cm/s", meaning),
            _spec("record", f"{name}_lower_cm_s", c, "f8", "cm/s", f"lower end of the interval of the {meaning}"),
            _spec("record", f"{name}_upper_cm_s", c, "f8", "cm/s", f"upper end of the interval of the {meaning}"),
        ]
    specs += [
        _spec("record", "g_se_cm_s", c, "f8", "cm/s", "standard error of g"),
        _spec("record", "max_cm_s", c, "f8", "cm/s", "largest contact speed of the ensemble"),
        _spec("record", "p_nc", c, "f8", "1", "fraction not closed at the horizon"),
        *_interval_specs("p_nc", c, "p_nc"),
        _spec("record", "p_contact", c, "f8", "1", "fraction that touched"),
        _spec("record", "p_above_v_u", c, "f8", "1", "fraction of the switches in contact with V > v_u"),
        _spec("record", "p_above_v_u_half_width", c, "f8", "1", "half-width a of Eq. 11 for p_above_v_u"),
        _spec("record", "p_exceed", cl, "f8", "1", "fraction of the switches in contact with V > limit"),
        *_interval_specs("p_exceed", cl, "p_exceed"),
        _spec("digest", "markers_digest", c, "u8", "1", "xxh3 of the markers of all its chunks; 0: not written"),
        _spec("digest", "record_digest", c, "u8", "1", "xxh3 of the record; 0: not written"),
        _spec("wall", "wall_propose_s", c, "f8", "s", "time spent proposing"),
        _spec("wall", "wall_simulate_s", c, "f8", "s", "time from submission to the last chunk"),
        _spec("wall", "wall_committed_unix_s", c, "f8", "s", "when the candidate was committed, Unix time"),
        _spec("digest", "wall_record_digest", c, "u8", "1", "xxh3 of the timings"),
    ]
    return specs


SWITCH_ARRAYS: tuple[ArraySpec, ...] = tuple(_switch_specs())
CANDIDATE_ARRAYS: tuple[ArraySpec, ...] = tuple(_candidate_specs())
PROPOSAL_FIELDS = tuple(s for s in CANDIDATE_ARRAYS if s.role == "proposal")
RECORD_FIELDS = tuple(s for s in CANDIDATE_ARRAYS if s.role == "record")
WALL_FIELDS = tuple(s for s in CANDIDATE_ARRAYS if s.role == "wall")
MARKER = _spec("marker", "chunk_digest", "candidate chunk array", "u8", "1", "xxh3 of each chunk; 0: not written")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layout:
    """Sizes of one campaign's arrays, all at full capacity."""

    n_candidates: int
    """Most candidates: the whole budget."""
    n_switches: int
    """Rows of the stored ensemble: the most switches that any candidate uses."""
    chunk_switches: int
    """Switches per chunk, the unit of distributed work."""
    times_us: NDArray[np.float64]
    """Uniform time grid of x and v [µs], (n_times,); empty stores neither."""
    max_impacts: int
    """Impact events kept per switch; 0 keeps none."""
    n_pulses: int
    """Most pulses of a waveform."""
    limits_cm_s: tuple[float, ...] = (19.7,)
    """Contact speeds for which P(V > limit) is stored [cm/s]."""

    def __post_init__(self) -> None:
        for name, least in (
            ("n_candidates", 1),
            ("n_switches", 1),
            ("chunk_switches", 1),
            ("max_impacts", 0),
            ("n_pulses", 1),
        ):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
                raise LayoutError(f"{name} is {value!r}; it must be an integer of at least {least}")
            object.__setattr__(self, name, int(value))
        times = np.asarray(self.times_us, dtype=np.float64)
        if times.ndim != 1 or not np.all(np.isfinite(times)) or not np.all(np.diff(times) > 0):
            raise LayoutError("times_us must be a list of finite, increasing instants in µs")
        object.__setattr__(self, "times_us", times)
        object.__setattr__(self, "limits_cm_s", tuple(float(v) for v in self.limits_cm_s))
        object.__setattr__(self, "chunk_switches", min(self.chunk_switches, self.n_switches))
        if self.n_chunks > MAX_CHUNKS:
            raise LayoutError(
                f"chunks of {self.chunk_switches} switches cut {self.n_switches} switches into {self.n_chunks} chunks; "
                f"at most {MAX_CHUNKS} are allowed, so that the number of files stays bounded: "
                f"use chunks of {math.ceil(self.n_switches / MAX_CHUNKS)} switches or more"
            )
        self.inner_switches  # noqa: B018 - raises where chunk_switches cannot be cut

    @property
    def n_chunks(self) -> int:
        """Chunks of a candidate that uses the whole ensemble."""
        return self.chunks_of(self.n_switches)

    def chunks_of(self, n_switches: int) -> int:
        """Chunks of a candidate that uses n_switches of the ensemble."""
        return math.ceil(n_switches / self.chunk_switches)

    def rows(self, i_chunk: int, n_switches: int) -> slice:
        """Rows of the ensemble in one chunk of a candidate that uses n_switches."""
        start = i_chunk * self.chunk_switches
        return slice(start, min(start + self.chunk_switches, n_switches))

    @property
    def inner_switches(self) -> int:
        """Switches in an inner chunk: the largest divisor of chunk_switches up to MAX_INNER."""
        n = self.chunk_switches
        if n <= MAX_INNER:
            return n
        inner = next(d for d in range(MAX_INNER, 0, -1) if n % d == 0)
        if inner < MIN_INNER:
            raise LayoutError(
                f"chunk_switches is {n}, which has no divisor between {MIN_INNER} and {MAX_INNER}; "
                f"use a multiple of {MIN_INNER}, for example {math.ceil(n / MIN_INNER) * MIN_INNER}"
            )
        return inner

    @property
    def record_chunk(self) -> int:
        """Candidates in one chunk of a per-candidate array: equal parts, so that hardly any chunk is a partial one."""
        return math.ceil(self.n_candidates / math.ceil(self.n_candidates / RECORD_CHUNK))

    @property
    def n_record_chunks(self) -> int:
        """Chunks of a per-candidate array."""
        return math.ceil(self.n_candidates / self.record_chunk)

    @property
    def switch_arrays(self) -> tuple[ArraySpec, ...]:
        """Arrays that workers write."""
        dims = set() if self.max_impacts else {"impact"}
        dims |= set() if self.times_us.size else {"time"}
        return tuple(s for s in SWITCH_ARRAYS if not dims & set(s.dims))

    @property
    def marker_names(self) -> tuple[str, ...]:
        """Coordinate `array` of the markers: the proposal's digest, then one digest per array."""
        return ("proposal", *(s.name for s in self.switch_arrays))

    @property
    def sizes(self) -> dict[str, int]:
        """Length of every dimension, at full capacity."""
        return {
            "candidate": self.n_candidates,
            "switch": self.n_switches,
            "time": self.times_us.size,
            "impact": self.max_impacts,
            "pulse": self.n_pulses,
            "parameter": len(PARAMETERS),
            "limit": len(self.limits_cm_s),
            "hyperparameter": N_SURROGATE,
            "chunk": self.n_chunks,
            "array": len(self.marker_names),
        }

    def shape(self, spec: ArraySpec) -> tuple[int, ...]:
        """Shape at full capacity."""
        return tuple(self.sizes[d] for d in spec.dims)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for the root's attributes; the time grid is an array of its own."""
        return {
            "n_candidates": self.n_candidates,
            "n_switches": self.n_switches,
            "chunk_switches": self.chunk_switches,
            "n_times": int(self.times_us.size),
            "max_impacts": self.max_impacts,
            "n_pulses": self.n_pulses,
            "limits_cm_s": list(self.limits_cm_s),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], times_us: NDArray[np.float64]) -> Layout:
        """The inverse of `to_dict`."""
        values = {
            name: data[name] for name in ("n_candidates", "n_switches", "chunk_switches", "max_impacts", "n_pulses")
        }
        return cls(**values, times_us=times_us, limits_cm_s=tuple(data["limits_cm_s"]))


def chunk_key(name: str, *indices: int) -> str:
    """Key of one chunk (one file) of an array."""
    return f"{name}/{CHUNK_KEY_SEPARATOR.join(['c', *map(str, indices)])}"


def is_chunk_key(key: str) -> bool:
    """True for the key of a chunk, false for metadata."""
    return key.rpartition("/")[2].startswith(f"c{CHUNK_KEY_SEPARATOR}")


def check_schema(version: Any, where: str) -> None:
    """Raise SchemaError unless this program reads the store's schema version."""
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise SchemaError(f"{where} has schema version {version!r}, which no softclose writes: is it damaged?")
    if version > SCHEMA_VERSION:
        raise SchemaError(
            f"{where} has schema version {version}; this version of softclose reads up to {SCHEMA_VERSION}: "
            "upgrade softclose to read it"
        )
