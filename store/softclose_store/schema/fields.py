"""Owns the fields of a store: every named value of a candidate and of a switch, with unit and meaning."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

SCHEMA_VERSION = 3
"""Version of this schema; a store of another one is refused by name."""

N_SURROGATE = 32
"""Most quantities that the proposals of a campaign may say about their surrogates."""

PARAMETERS = {
    "start_us": ("start", "µs"),
    "rise_us": ("rise time", "µs"),
    "peak_us": ("time at the peak, inf: holds", "µs"),
    "volts": ("voltage", "V"),
}
"""Columns of a waveform: name -> (meaning, unit)."""


@dataclass(frozen=True, slots=True)
class PopulationColumn:
    """A property of every switch of a population. Which there are is for whoever creates the store to say."""

    name: str
    """Its array's name."""
    unit: str
    """Its unit; "1" where there is none."""
    long_name: str
    """What it is, in words."""


@dataclass(frozen=True, slots=True)
class CaseColumn:
    """What tells the cases apart in which every switch is simulated, such as its temperature."""

    name: str
    """Its array's name."""
    unit: str
    """Its unit; "1" where there is none."""
    long_name: str
    """What it is, in words."""
    values: tuple[float, ...]
    """One a case."""


@dataclass(frozen=True, slots=True)
class Constant:
    """A number that every switch of a campaign shares."""

    value: float
    """The number."""
    unit: str
    """Its unit; "1" where there is none."""
    long_name: str
    """What it is, in words."""


PLATE: tuple[PopulationColumn, ...] = (
    PopulationColumn("D", "µm", "travel to contact"),
    PopulationColumn("G", "µm", "electrostatic gap"),
    PopulationColumn("E", "GPa", "Young's modulus"),
    PopulationColumn("T", "µm", "thickness"),
    PopulationColumn("K", "N/m", "stiffness"),
    PopulationColumn("M", "µg", "effective mass"),
)
"""Columns of a population of plates under one drive."""

INTERVALS = ("wald", "wilson", "clopper_pearson")
"""Intervals kept for each probability."""

Type = Literal["float", "int", "bool", "text"]
Part = Literal["proposal", "result", "wall"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One named value of a candidate, or of a switch."""

    name: str
    """Name, with its unit where it is a float that crosses a boundary."""
    type: Type = "float"
    """What it is to a reader; tables of numbers store it as float64."""
    unit: str = "1"
    """Unit; "1" where there is none."""
    long_name: str = ""
    """What it is, in words."""
    part: Part = "result"
    """Who knows it: the proposal, the assessment of its responses (result), or the clock (wall)."""
    per_limit: bool = False
    """True where there is one for each of the layout's contact-speed limits."""

    @property
    def fill(self) -> float:
        """What a table of numbers holds where nothing was said."""
        return {"float": math.nan, "int": -1.0, "bool": 0.0, "text": math.nan}[self.type]


def _interval_fields(name: str, meaning: str, per_limit: bool = False) -> list[Field]:
    return [
        Field(
            name=f"{name}_{kind}_{end}", long_name=f"{end} end of the {kind} interval of {meaning}", per_limit=per_limit
        )
        for kind in INTERVALS
        for end in ("lower", "upper")
    ]


def _speed_fields(name: str, meaning: str) -> list[Field]:
    return [
        Field(name=f"{name}_cm_s", unit="cm/s", long_name=meaning),
        Field(name=f"{name}_lower_cm_s", unit="cm/s", long_name=f"lower end of the interval of the {meaning}"),
        Field(name=f"{name}_upper_cm_s", unit="cm/s", long_name=f"upper end of the interval of the {meaning}"),
    ]


N_SWITCHES = Field(
    name="n_switches", type="int", long_name="switches that the candidate is evaluated on", part="proposal"
)
PROPOSALS: tuple[Field, ...] = (N_SWITCHES,)
"""Numbers that a proposal says beyond its waveform and design: a further one is one line here."""
DESIGN_PREFIX = "design_"
"""Fields of `records` that hold a nominal value which the search may change begin with this."""

WAVE = Field(name="wave", type="int", long_name="wave in which the candidate was proposed, counted from 0")

RESULTS: tuple[Field, ...] = (
    Field(name="failed", type="bool", long_name="no usable result exists"),
    Field(name="feasible", type="bool", long_name="p_nc is at most its limit (always true in the penalty form)"),
    Field(name="n_failed_switches", type="int", long_name="switches that could not be integrated"),
    *_speed_fields("g", "objective g, Eq. 10"),
    *_speed_fields("v_u", "upper velocity, Eqs. 8-9"),
    *_speed_fields("cvar", "mean contact speed above the upper velocity"),
    *_speed_fields("mean", "mean contact speed"),
    Field(name="g_se_cm_s", unit="cm/s", long_name="standard error of g"),
    Field(
        name="rank_cm_s",
        unit="cm/s",
        long_name="what candidates are ranked by: g, or behind every g by p_nc where more than max_open stay open",
    ),
    Field(name="max_cm_s", unit="cm/s", long_name="largest contact speed of the ensemble"),
    Field(name="p_nc", long_name="fraction not closed at the horizon"),
    *_interval_fields("p_nc", "p_nc"),
    Field(name="p_contact", long_name="fraction that touched"),
    Field(name="closing_us", unit="µs", long_name="closing time of the lot: quantile of settling; inf: too many open"),
    Field(name="closing_lower_us", unit="µs", long_name="lower end of the interval of the closing time"),
    Field(name="closing_upper_us", unit="µs", long_name="upper end of the interval of the closing time"),
    Field(name="p_above_v_u", long_name="fraction of the switches in contact with V > v_u"),
    Field(name="p_above_v_u_half_width", long_name="half-width a of Eq. 11 for p_above_v_u"),
    Field(name="p_exceed", long_name="fraction of the switches in contact with V > limit", per_limit=True),
    *_interval_fields("p_exceed", "p_exceed", per_limit=True),
    *(replace(field, per_limit=True) for field in _speed_fields("excess", "expected excess over the limit")),
)
"""What an assessment says of a candidate."""

WORDS: tuple[Field, ...] = (
    Field(name="origin", type="text", long_name="who proposed the candidate", part="proposal"),
    Field(name="note", type="text", long_name="why something unusual was done", part="proposal"),
    Field(name="failure", type="text", long_name="why the candidate failed"),
)
"""What is said of a candidate in words."""

WALL: tuple[Field, ...] = (
    Field(name="wall_propose_s", unit="s", long_name="time spent proposing", part="wall"),
    Field(name="wall_simulate_s", unit="s", long_name="time from submission to the last block", part="wall"),
    Field(name="wall_committed_unix_s", unit="s", long_name="when it was committed, Unix time", part="wall"),
    Field(name="wall_check", long_name="53 bits of the xxh3 of the timings before it", part="wall"),
)
"""Timings: the only values that two runs of one campaign do not share."""

RECORDED: tuple[Field, ...] = (*PROPOSALS, WAVE, *RESULTS, *WORDS, *WALL)
"""Every value of a candidate that is one number or one text."""

DIGESTS = ("proposal", "markers", "record")
"""Digests of a candidate: xxh3 of its proposal, of its blocks' markers, of its result; 0: not written."""

RESPONSE_QUANTITIES: tuple[Field, ...] = (
    Field(name="max_contact_speed", unit="µm/µs", long_name="largest contact speed V, Eq. 7; NaN: never touched"),
    Field(name="first_contact", unit="µs", long_name="instant of the first contact; inf: never"),
    Field(name="settling", unit="µs", long_name="instant from which it is held to the horizon; inf: never"),
    Field(name="n_impacts", type="int", long_name="number of impacts"),
    Field(name="final_x", unit="µm", long_name="travel at the horizon"),
    Field(name="final_v", unit="µm/µs", long_name="velocity at the horizon"),
    Field(name="closed", type="bool", long_name="held in contact at the horizon, and from the objective's limit on"),
    Field(name="status", type="int", long_name="outcome of the integration; 0: ok, -1 or NaN: not simulated"),
)
"""Coordinate `quantity` of `response`: what is kept of a switch under a candidate, in this order."""

IMPACT_QUANTITIES: tuple[Field, ...] = (
    Field(name="time", unit="µs", long_name="instants of the first impacts; NaN beyond the last"),
    Field(name="speed", unit="µm/µs", long_name="speeds just before the first impacts"),
)
"""Coordinate `impact_quantity` of `impact`, in this order."""

SURROGATE_PREFIX = "surrogate."
"""Columns of `records()` and `history()` that say what a proposal's surrogate predicted begin with this."""


_UNITS = {"_cm_s": "cm/s", "_us": "µs", "_s": "s", "_V": "V", "_um": "µm"}


def unit_in(name: str) -> str:
    """The unit that a name ends with, as every name of a surrogate's quantity that has one does; "1" for others."""
    return next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), "1")


def asked_fields(asked: Sequence[PopulationColumn]) -> tuple[Field, ...]:
    """What a record says of each further quantity: its value, and both ends of its interval."""
    return tuple(
        Field(name=f"{q.name}{end}", unit=q.unit, long_name=f"{meaning}{q.long_name}")
        for q in asked
        for end, meaning in (
            ("", "of the lot: "),
            ("_lower", "lower end of the interval of the "),
            ("_upper", "upper end of the interval of the "),
        )
    )


def told_fields(told: Sequence[PopulationColumn]) -> tuple[Field, ...]:
    """What a record says beside its figures: one number each."""
    return tuple(Field(name=q.name, unit=q.unit, long_name=q.long_name) for q in told)


def number_fields(
    n_pulses: int,
    limits_cm_s: Sequence[float],
    designs: Sequence[PopulationColumn] = (),
    asked: Sequence[PopulationColumn] = (),
    told: Sequence[PopulationColumn] = (),
) -> tuple[Field, ...]:
    """Columns of the table of records, in order: the proposal's first, one for each pulse parameter and each limit.

    designs: nominal values that the search may change; asked: further quantities of switches and drives; told: what is
    said of a candidate beside its figures.
    """
    pulses = [
        Field(
            name=f"pulse{k}_{name}", unit=unit, long_name=f"{meaning} of pulse {k}; NaN: no such pulse", part="proposal"
        )
        for k in range(1, n_pulses + 1)
        for name, (meaning, unit) in PARAMETERS.items()
    ]
    results = [
        replace(field, name=f"{field.name}_{text}", long_name=f"{field.long_name}, limit {text} cm/s", per_limit=False)
        if field.per_limit
        else field
        for field in (*RESULTS, *asked_fields(asked), *told_fields(told))
        for text in (limit_texts(limits_cm_s) if field.per_limit else [""])
    ]
    nominal = [
        Field(
            name=f"{DESIGN_PREFIX}{d.name}", unit=d.unit, long_name=f"nominal {d.long_name}; NaN: the population's own",
            part="proposal",
        )
        for d in designs
    ]  # fmt: skip
    return (*pulses, *nominal, *PROPOSALS, WAVE, *results)


def limit_texts(limits_cm_s: Sequence[float]) -> list[str]:
    """What a limit is called in the names of columns: short where that tells them apart."""
    short = [f"{limit:g}" for limit in limits_cm_s]
    return short if len(set(short)) == len(short) else [repr(float(limit)) for limit in limits_cm_s]
