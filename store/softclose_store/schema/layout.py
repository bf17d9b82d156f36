"""Owns the sizes of a campaign's arrays: its stages, their blocks, and the chunks of its tables."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose_store.errors import LayoutError, RecordError, SchemaError
from softclose_store.schema.fields import (
    IMPACT_QUANTITIES,
    PARAMETERS,
    PLATE,
    PROPOSALS,
    RESPONSE_QUANTITIES,
    RESULTS,
    SCHEMA_VERSION,
    CaseColumn,
    Field,
    PopulationColumn,
    asked_fields,
    number_fields,
    told_fields,
)

MAX_BLOCKS = 256
"""Most blocks along the switches of a stage: bounds the files a candidate, whatever the number of switches."""

MAX_INNER = 8192
"""Most trajectories in one inner Zarr chunk, the unit of partial reads: 33 MB of x at 1,001 points, 15 ms to decode.
Blocks up to this size are no shards: cutting them up costs zarr a copy and 0.1 ms of Python each (docs/adr/021)."""

MIN_INNER = 128
"""Fewest switches in an inner chunk of a sharded array: every inner chunk costs 0.1 ms of Python."""

TABLE_CHUNK = 128
"""Most candidates in one chunk of a table: few files, and a commit rewrites only the last of each."""

_STAGE_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
_TAKEN = tuple(field.name for field in (*RESULTS, *RESPONSE_QUANTITIES))
_COLUMN_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")
CANDIDATES, POPULATION, RUNTIME = "candidates", "population", "runtime"
"""Groups beside the stages: the tables, a row a candidate; the ensemble; who ran the campaign. xarray's trees want
dimensions of one name and two lengths in groups beside one another, never one inside the other."""
OWN_GROUPS = (CANDIDATES, POPULATION, RUNTIME)
RESERVED = frozenset({*OWN_GROUPS, "certification", "opening", "traces", "trajectories", "prior"})
"""Names at a store's root that no stage may take."""
CASE_PREFIX = "case_"
"""Arrays of a stage that hold the same in every case begin with this."""


def largest_inner(block_switches: int) -> int:
    """The most switches of an inner chunk that divide a block of more than one chunk; too few below MIN_INNER."""
    return next(d for d in range(min(MAX_INNER, block_switches), 0, -1) if block_switches % d == 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class StageLayout:
    """Sizes of one stage: its candidates, its ensemble, and how both are cut into blocks."""

    name: str
    """Name of the stage and of its group."""
    n_candidates: int
    """Most candidates: the stage's budget."""
    n_switches: int
    """Switches of its ensemble: the first ones of the population."""
    block_candidates: int
    """Candidates in a block."""
    block_switches: int
    """Switches in a block."""
    engine: str = ""
    """Who proposes its candidates."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not _STAGE_NAME.fullmatch(self.name) or self.name in RESERVED:
            raise LayoutError(f"a stage is called {self.name!r}; a name is made of a-z, 0-9 and _, such as search")
        for name in ("n_candidates", "n_switches", "block_candidates", "block_switches"):
            object.__setattr__(self, name, _integer(f"{name} of stage {self.name}", getattr(self, name), 1))
        object.__setattr__(self, "block_candidates", min(self.block_candidates, self.n_candidates))
        object.__setattr__(self, "block_switches", min(self.block_switches, self.n_switches))
        if self.n_block_switches > MAX_BLOCKS:
            raise LayoutError(
                f"blocks of {self.block_switches} switches cut the {self.n_switches} switches of stage {self.name} "
                f"into {self.n_block_switches} blocks; at most {MAX_BLOCKS} are allowed, so that the number of files "
                f"stays bounded: use blocks of {math.ceil(self.n_switches / MAX_BLOCKS)} switches or more"
            )
        self.inner  # noqa: B018 - raises where a block cannot be cut

    @property
    def n_block_candidates(self) -> int:
        """Blocks along the candidates."""
        return math.ceil(self.n_candidates / self.block_candidates)

    @property
    def n_block_switches(self) -> int:
        """Blocks along the switches."""
        return self.blocks_of(self.n_switches)

    def blocks_of(self, n_switches: int) -> int:
        """Blocks along the switches that n_switches of the ensemble need."""
        return math.ceil(n_switches / self.block_switches)

    def candidates(self, i_block: int) -> slice:
        """Candidates of the stage, counted from its first, in one row of blocks."""
        start = i_block * self.block_candidates
        return slice(start, min(start + self.block_candidates, self.n_candidates))

    def switches(self, j_block: int) -> slice:
        """Switches in one column of blocks."""
        start = j_block * self.block_switches
        return slice(start, min(start + self.block_switches, self.n_switches))

    def block_shape(self, i_block: int, j_block: int) -> tuple[int, int]:
        """(candidates, switches) of a block: the last of a row or column may be short.

        Parameters
        ----------
        i_block, j_block : int
            Its row and column.

        Raises
        ------
        LayoutError
            Where there is no such block.
        """
        if not 0 <= i_block < self.n_block_candidates or not 0 <= j_block < self.n_block_switches:
            raise LayoutError(
                f"block ({i_block}, {j_block}) is outside the {self.n_block_candidates} by {self.n_block_switches} "
                f"blocks of stage {self.name}"
            )
        rows, columns = self.candidates(i_block), self.switches(j_block)
        return rows.stop - rows.start, columns.stop - columns.start

    @property
    def inner(self) -> tuple[int, int]:
        """(candidates, switches) of an inner chunk: the whole block up to MAX_INNER trajectories, else a divisor."""
        if self.block_candidates * self.block_switches <= MAX_INNER:
            return self.block_candidates, self.block_switches
        if self.block_switches <= MAX_INNER:
            most = MAX_INNER // self.block_switches
            return next(d for d in range(most, 0, -1) if self.block_candidates % d == 0), self.block_switches
        switches = largest_inner(self.block_switches)
        if switches < MIN_INNER:
            n = self.block_switches
            raise LayoutError(
                f"block_switches of stage {self.name} is {n}, which has no divisor between {MIN_INNER} and "
                f"{MAX_INNER}; use a multiple of {MIN_INNER}, for example {math.ceil(n / MIN_INNER) * MIN_INNER}"
            )
        return 1, switches


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layout:
    """Sizes of one campaign's arrays, all at full capacity. The stages' candidates follow one another."""

    stages: tuple[StageLayout, ...]
    """The stages, in the order of their candidates."""
    times_us: NDArray[np.float64]
    """Uniform time grid of x and v [µs], (n_times,); empty stores neither."""
    max_impacts: int
    """Impact events kept per switch; 0 keeps none."""
    n_pulses: int
    """Most pulses of a waveform."""
    limits_cm_s: tuple[float, ...] = (19.7,)
    """Contact speeds for which P(V > limit) is stored [cm/s]."""
    columns: tuple[PopulationColumn, ...] = PLATE
    """Columns of the population."""
    designs: tuple[PopulationColumn, ...] = ()
    """Nominal values that a candidate may have of its own."""
    asked: tuple[PopulationColumn, ...] = ()
    """Further quantities that are kept of every switch, and told of every candidate."""
    told: tuple[PopulationColumn, ...] = ()
    """What is said of every candidate beside its figures, one number each."""
    cases: tuple[CaseColumn, ...] = ()
    """What tells the cases apart in which each switch is simulated, one value a case; none: there is one case."""
    n_modes: int = 1
    """Modes of a switch: of the further ones x(t) and v(t) are kept too."""
    table_chunk: int = 0
    """Candidates in one chunk of a table; 0: equal parts, so that hardly any chunk is a partial one. An extension keeps
    what it finds."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "stages", tuple(self.stages))
        names = [stage.name for stage in self.stages]
        if not names or len(set(names)) < len(names):
            raise LayoutError(f"the stages are {names}; there must be one or more, each of another name")
        for name, least in (("max_impacts", 0), ("n_pulses", 1), ("n_modes", 1)):
            object.__setattr__(self, name, _integer(name, getattr(self, name), least))
        times = np.asarray(self.times_us, dtype=np.float64)
        if times.ndim != 1 or not np.all(np.isfinite(times)) or not np.all(np.diff(times) > 0):
            raise LayoutError("times_us must be a list of finite, increasing instants in µs")
        object.__setattr__(self, "times_us", times)
        limits = tuple(float(v) for v in self.limits_cm_s)
        if len(set(limits)) < len(limits):
            raise LayoutError(f"limits_cm_s is {limits}; each limit is stored once")
        object.__setattr__(self, "limits_cm_s", limits)
        _check_names("the population", [column.name for column in self.columns], least=1)
        _check_names("the design of a candidate", [column.name for column in self.designs])
        _check_names("what is asked of a switch", [column.name for column in self.asked], taken=_TAKEN)
        _check_names("what is told of a candidate", [column.name for column in self.told], taken=_TAKEN)
        _check_names("a case", [column.name for column in self.cases], taken=STAGE_NAMES)
        if len({len(column.values) for column in self.cases}) > 1 or any(not c.values for c in self.cases):
            raise LayoutError(f"the cases are {self.cases}; each column has one value a case, as many as the others")
        object.__setattr__(self, "table_chunk", _integer("table_chunk", self.table_chunk or self._equal_parts, 1))

    @property
    def n_candidates(self) -> int:
        """Most candidates: the whole budget."""
        return sum(stage.n_candidates for stage in self.stages)

    @property
    def n_switches(self) -> int:
        """Rows of the stored population: the largest stage's ensemble."""
        return max(stage.n_switches for stage in self.stages)

    def stage(self, name: str) -> StageLayout:
        """The stage of a name; raises LayoutError."""
        for stage in self.stages:
            if stage.name == name:
                return stage
        raise LayoutError(f"there is no stage {name!r}; the campaign has {', '.join(s.name for s in self.stages)}")

    def first(self, name: str) -> int:
        """Campaign-wide index of the first candidate of a stage."""
        at = self.stages.index(self.stage(name))
        return sum(stage.n_candidates for stage in self.stages[:at])

    def stage_of(self, i: int) -> tuple[StageLayout, int]:
        """The stage of a candidate, and the candidate's index in it."""
        if i >= 0:
            local = i
            for stage in self.stages:
                if local < stage.n_candidates:
                    return stage, local
                local -= stage.n_candidates
        raise RecordError(f"candidate {i} is outside the budget of {self.n_candidates} candidates")

    def committed_of(self, stage: StageLayout, n_committed: int) -> int:
        """How many of a stage's candidates are committed.

        Parameters
        ----------
        stage : StageLayout
            The stage.
        n_committed : int
            Committed candidates of the campaign.
        """
        return min(max(n_committed - self.first(stage.name), 0), stage.n_candidates)

    def wave_blocks(self, start: int, size: int, n_switches: int) -> list[tuple[int, int]]:
        """All blocks of a wave, row by row.

        Parameters
        ----------
        start, size : int
            First candidate and number of candidates.
        n_switches : int
            Size of their ensemble.

        Returns
        -------
        list of (int, int)
            (i_block, j_block) each.

        Raises
        ------
        RecordError
            Where the wave does not fit the blocks.
        """
        stage, local = self.stage_of(start)
        stop = local + size
        if size < 1 or stop > stage.n_candidates:
            raise RecordError(
                f"a wave of {size} candidates from candidate {start} on does not lie in stage {stage.name}, which has "
                f"{stage.n_candidates - local} left"
            )
        step = stage.block_candidates
        if local % step or (stop % step and stop != stage.n_candidates):
            raise RecordError(
                f"a wave of {size} candidates from candidate {local} of stage {stage.name} on cuts a block of "
                f"{step} candidates in two; waves begin and end with a block"
            )
        if not 0 < n_switches <= stage.n_switches:
            raise RecordError(
                f"n_switches is {n_switches}; stage {stage.name} holds 1 to {stage.n_switches} switches a candidate"
            )
        rows = range(local // step, math.ceil(stop / step))
        return [(i, j) for i in rows for j in range(stage.blocks_of(n_switches))]

    def of_stages(self, attribute: str) -> NDArray[Any]:
        """A text of its stage (`name`, `engine`) for each candidate, (n_candidates,)."""
        texts = np.array([getattr(stage, attribute) for stage in self.stages], dtype=np.dtypes.StringDType())
        return np.repeat(texts, [stage.n_candidates for stage in self.stages])

    @property
    def fields(self) -> tuple[Field, ...]:
        """Columns of the table of records."""
        return number_fields(self.n_pulses, self.limits_cm_s, self.designs, self.asked, self.told)

    @property
    def results(self) -> tuple[Field, ...]:
        """What an assessment says of a candidate."""
        return (*RESULTS, *asked_fields(self.asked), *told_fields(self.told))

    @property
    def quantities(self) -> tuple[Field, ...]:
        """Columns of `response`."""
        return (*RESPONSE_QUANTITIES, *(Field(name=q.name, unit=q.unit, long_name=q.long_name) for q in self.asked))

    @property
    def n_proposal_fields(self) -> int:
        """How many of the columns, from the first on, belong to the proposal."""
        return self.n_pulses * len(PARAMETERS) + len(self.designs) + len(PROPOSALS)

    @property
    def n_cases(self) -> int:
        """Cases in which each switch is simulated."""
        return len(self.cases[0].values) if self.cases else 1

    @property
    def _equal_parts(self) -> int:
        return math.ceil(self.n_candidates / math.ceil(self.n_candidates / TABLE_CHUNK))

    @property
    def n_table_chunks(self) -> int:
        """Chunks of a table."""
        return math.ceil(self.n_candidates / self.table_chunk)

    @property
    def block_arrays(self) -> dict[str, tuple[tuple[int, ...], str]]:
        """Arrays of a block: name -> (shape behind candidate and switch, numpy type).

        Those without prefix hold what counts of a switch, in every campaign alike; where there are several cases, its
        twin with `CASE_PREFIX` holds the same of each.
        """
        arrays: dict[str, tuple[tuple[int, ...], str]] = {"response": ((len(self.quantities),), "f8")}
        if self.max_impacts:
            arrays["impact"] = ((self.max_impacts, len(IMPACT_QUANTITIES)), "f8")
        if self.times_us.size:
            arrays |= {name: ((self.times_us.size,), "f4") for name in ("x", "v")}
            if self.n_modes > 1:
                arrays |= {name: ((self.n_modes - 1, self.times_us.size), "f4") for name in ("mode_x", "mode_v")}
        if self.n_cases > 1:
            arrays |= {f"{CASE_PREFIX}{name}": ((self.n_cases, *rest), kind) for name, (rest, kind) in arrays.items()}
        return arrays

    @property
    def marker_names(self) -> tuple[str, ...]:
        """What a marker consists of: the proposals' digest, one digest per array, and that of what is assessed."""
        return ("proposals", *self.block_arrays, "assessed")

    def to_dict(self) -> dict[str, Any]:
        """The layout as JSON values, without the time grid, which is an array."""
        data: dict[str, Any] = {
            "stages": [asdict(stage) for stage in self.stages],
            "n_times": int(self.times_us.size),
            "max_impacts": self.max_impacts,
            "n_pulses": self.n_pulses,
            "limits_cm_s": list(self.limits_cm_s),
            "columns": [[c.name, c.unit, c.long_name] for c in self.columns],
            "designs": [[c.name, c.unit, c.long_name] for c in self.designs],
            "asked": [[c.name, c.unit, c.long_name] for c in self.asked],
            "cases": [[c.name, c.unit, c.long_name, list(c.values)] for c in self.cases],
            "n_modes": self.n_modes,
        }
        if self.told:
            data["told"] = [[c.name, c.unit, c.long_name] for c in self.told]
        return data if self.table_chunk == self._equal_parts else data | {"table_chunk": self.table_chunk}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], times_us: NDArray[np.float64]) -> Layout:
        """The inverse of `to_dict`.

        Parameters
        ----------
        data : mapping
            JSON values.
        times_us : (n_times,) ndarray of float64
            The time grid [µs].
        """
        kept = ("max_impacts", "n_pulses", "limits_cm_s", "n_modes")
        stages = tuple(StageLayout(**stage) for stage in data["stages"])
        return cls(
            stages=stages,
            times_us=times_us,
            columns=tuple(PopulationColumn(*column) for column in data["columns"]),
            designs=tuple(PopulationColumn(*column) for column in data["designs"]),
            asked=tuple(PopulationColumn(*column) for column in data["asked"]),
            told=tuple(PopulationColumn(*column) for column in data.get("told", ())),
            cases=tuple(CaseColumn(name, unit, meaning, tuple(v)) for name, unit, meaning, v in data["cases"]),
            table_chunk=data.get("table_chunk", 0),
            **{name: data[name] for name in kept},
        )


def _integer(name: str, value: Any, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise LayoutError(f"{name} is {value!r}; it must be an integer of at least {least}")
    return int(value)


STAGE_NAMES = ("time", "event", "marker", "quantity", "impact_quantity", "response", "impact", "x", "v")
"""Names within a stage that no column of its cases may take."""


def _check_names(what: str, names: list[str], *, least: int = 0, taken: tuple[str, ...] = ()) -> None:
    """Raise LayoutError unless all are names of arrays, each another one."""
    taken = ("switch", "candidate", "case", "mode", *taken)
    wrong = [n for n in names if not isinstance(n, str) or not _COLUMN_NAME.fullmatch(n) or n in taken]
    if wrong or len(names) < least or len(set(names)) < len(names):
        raise LayoutError(
            f"{what} has columns {names}; each has a name of its own made of letters, digits and _, none of "
            f"{', '.join(taken)}" + (", and there is one at least" if least else "")
        )


def check_schema(version: Any, where: str) -> None:
    """Raise SchemaError unless this program reads the store's schema version."""
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise SchemaError(f"{where} has schema version {version!r}, which no softclose writes: is it damaged?")
    if version < SCHEMA_VERSION:
        raise SchemaError(
            f"{where} has schema version {version}, which an earlier softclose wrote; this version of softclose reads "
            f"{SCHEMA_VERSION}: read the store with that one, or run its configuration again into another path"
        )
    if version > SCHEMA_VERSION:
        raise SchemaError(
            f"{where} has schema version {version}; this version of softclose reads {SCHEMA_VERSION}: "
            "upgrade softclose to read it"
        )
