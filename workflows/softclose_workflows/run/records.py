"""Owns the translation between the science's objects and the plain records that the store keeps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.evaluate.quantities import QUANTITIES, Value
from softclose.metrics.objective import Assessment
from softclose.propose.by_hand import ByHand, Corrected
from softclose.propose.protocol import Observation, Proposal
from softclose.waveform import Waveform
from softclose_store import Changed, GroupArray, Layout, result_of
from softclose_store.schema.fields import PARAMETERS, SURROGATE_PREFIX


def padded_rows(waveforms: Sequence[Waveform]) -> NDArray[np.float64]:
    """(n, n_pulses, 4) start, rise, peak, volts; rows of NaN behind the last pulse of a shorter one."""
    rows = np.full((len(waveforms), max(len(w.pulses) for w in waveforms), 4), math.nan)
    for row, waveform in zip(rows, waveforms, strict=True):
        row[: len(waveform.pulses)] = waveform.rows()
    return rows


def parameters() -> GroupArray:
    """What the columns of a waveform are."""
    return GroupArray(dims=("parameter",), values=np.array(list(PARAMETERS)), long_name="columns of a waveform")


def unpadded(rows: NDArray[np.float64]) -> Waveform:
    """The waveform of one row of `padded_rows`."""
    return Waveform.from_rows(rows[~np.isnan(rows).all(axis=1)])


def proposal_record(proposal: Proposal) -> dict[str, Any]:
    """What is stored of a proposal."""
    return {
        "waveform": proposal.waveform.rows(),
        "origin": proposal.origin,
        "n_switches": proposal.n_switches,
        "surrogate": dict(proposal.surrogate),
        "note": proposal.note,
    }


def assessment_record(a: Assessment, values: Mapping[str, Value] | None = None) -> dict[str, Any]:
    """What is stored of an assessment: every number with every interval.

    values: further quantities that the campaign asks for.
    """
    record: dict[str, Any] = {
        "failed": False,
        "failure": "",
        "g_cm_s": a.g_cm_s,
        "g_se_cm_s": a.g_se_cm_s,
        "rank_cm_s": a.rank_cm_s,
        "v_u_cm_s": a.v_u_cm_s,
        "mean_cm_s": a.mean_cm_s,
        "max_cm_s": a.max_cm_s,
        "p_nc": a.p_nc,
        "p_contact": a.p_contact,
        "closing_us": a.closing_us,
        "p_above_v_u": a.p_above_v_u,
        "p_above_v_u_half_width": a.p_above_v_u_half_width,
        "feasible": a.feasible,
        "n_failed_switches": a.n_failed,
        "cvar_cm_s": a.cvar_cm_s,
        "p_exceed": np.array([e.probability.estimate for e in a.p_exceed]),
        "excess_cm_s": np.array([e.excess_cm_s for e in a.p_exceed]),
        "excess_lower_cm_s": np.array([e.excess_interval[0] for e in a.p_exceed]),
        "excess_upper_cm_s": np.array([e.excess_interval[1] for e in a.p_exceed]),
    }
    for name, interval in (
        ("g", a.g_interval),
        ("v_u", a.v_u_interval),
        ("cvar", a.cvar_interval),
        ("mean", a.mean_interval),
    ):
        record[f"{name}_lower_cm_s"], record[f"{name}_upper_cm_s"] = interval
    record["closing_lower_us"], record["closing_upper_us"] = a.closing_interval
    for kind in ("wald", "wilson", "clopper_pearson"):
        record[f"p_nc_{kind}_lower"], record[f"p_nc_{kind}_upper"] = getattr(a.p_nc_intervals, kind)
        ends = [getattr(e.probability, kind) for e in a.p_exceed]
        record[f"p_exceed_{kind}_lower"] = np.array([lower for lower, _ in ends])
        record[f"p_exceed_{kind}_upper"] = np.array([upper for _, upper in ends])
    return record | value_record(values or {})


def value_record(values: Mapping[str, Value]) -> dict[str, float]:
    """What is stored of further quantities: each with both ends of its interval."""
    return {
        f"{name}{end}": number
        for name, value in values.items()
        for end, number in zip(("", "_lower", "_upper"), (value.estimate, *value.interval), strict=True)
    }


def failed_record(reason: str) -> dict[str, Any]:
    """The record of a candidate that could not be computed: every number undefined, and why."""
    return {"failed": True, "failure": reason}


def observation(index: int, wave: int, record: Mapping[str, Any], asked: Sequence[str] = ()) -> Observation:
    """One committed candidate as engines see it; asked: further quantities that they may look at."""
    return Observation(
        index=index,
        wave=wave,
        waveform=Waveform.from_rows(record["waveform"]),
        origin=str(record["origin"]),
        n_switches=int(record["n_switches"]),
        failed=bool(record["failed"]),
        beliefs={name: float(v) for name, v in record.get("surrogate", {}).items() if not math.isnan(v)},
        quantities={name: float(record.get(name, math.nan)) for name in asked},
        **{name: float(record.get(name, math.nan)) for name in OBSERVED},
    )


OBSERVED = ("g_cm_s", "g_se_cm_s", "rank_cm_s", "v_u_cm_s", "mean_cm_s", "p_nc", "p_contact", "closing_us")


def observations(records: Mapping[str, NDArray[Any]]) -> list[Observation]:
    """The whole history from the store's committed records."""
    asked = [name for name in QUANTITIES if name in records]
    names = ("wave", "waveform", "origin", "n_switches", "failed", *OBSERVED, *asked)
    columns = {name: records[name] for name in names}
    said = {
        name.removeprefix(SURROGATE_PREFIX): column
        for name, column in records.items()
        if name.startswith(SURROGATE_PREFIX)
    }
    return [
        observation(i, int(row["wave"]), row, asked)
        for i in range(len(columns["failed"]))
        for row in [
            {name: column[i] for name, column in columns.items()}
            | {"surrogate": {name: column[i] for name, column in said.items()}}
        ]
    ]


def by_hand(changes: Sequence[Changed], layout: Layout) -> ByHand:
    """What a person has changed, as proposals see it."""
    return ByHand(
        readings=tuple(
            Corrected(from_wave=change.from_wave, result=_result(change, layout))
            for change in changes
            if change.record is not None
        ),
        chosen={c.candidate: Waveform.from_rows(c.waveform) for c in changes if c.waveform is not None},
    )


def _result(change: Changed, layout: Layout) -> Observation:
    columns = result_of(change, layout)
    asked = [name for name in QUANTITIES if name in columns]
    row = {name: column[0] for name, column in columns.items()} | {"waveform": np.array([[0.0, 1.0, 0.0, 0.0]])}
    return observation(change.candidate, 0, row, asked)
