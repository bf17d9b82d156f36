"""Owns the front of a store: the candidates that no other beats in all of some objectives, and how it grew."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.digits import least_digits
from softclose.evaluate.asked import OF_THE_FRONT, asked
from softclose.evaluate.quantities import quantity
from softclose.metrics.pareto import hypervolume, pareto_front
from softclose.metrics.ranking import is_beyond
from softclose.propose.objectives import front_values, ideal_values, sign_of, worst_values
from softclose.propose.protocol import Observation
from softclose.settings import CampaignConfig
from softclose_store import open_campaign
from softclose_workflows.analyses.certification import CertifyError
from softclose_workflows.run.records import observations
from softclose_workflows.tell.console import wide_console
from softclose_workflows.tell.plain import finite, waveform_rows
from softclose_workflows.tell.tables import describe_waveform, metrics_row, with_interval

_STEPS = 40
"""Points of the growth at most."""
_LEAST = 1e-12
"""Least side of the box: all candidates may be alike in a quantity."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Front:
    """The front of the candidates that were evaluated on the most switches: scores on fewer are more optimistic."""

    objectives: tuple[str, ...]
    """What is weighed."""
    n_switches: int
    """Switches of the ensemble."""
    values: FloatArray
    """(n, k) of every candidate of the campaign; NaN where it is not compared."""
    worst: FloatArray
    """(k,) the corner of the hypervolume."""
    candidates: tuple[int, ...]
    """On the front, in its order."""
    growth: tuple[tuple[int, float], ...]
    """(candidates so far, hypervolume that they dominate, 1 is ideal)."""


def front_of(history: Sequence[Observation], config: CampaignConfig, objectives: Sequence[str] = ()) -> Front | None:
    """The front of a campaign's candidates; objectives: those of its own optimiser by default; None: nothing usable."""
    chosen = tuple(objectives) or config.optimiser.objectives
    known = {*OF_THE_FRONT, *(q.name for q in asked(config))}
    unknown = [name for name in chosen if name not in known]
    if unknown:
        raise CertifyError(
            f"the campaign keeps no {unknown[0]}; its candidates compare by {', '.join(sorted(known))}: another "
            "quantity is kept where objective.lines names it"
        )
    values = front_values(config, history, chosen)
    sizes = np.array([o.n_switches for o in history], dtype=np.int64)
    usable = np.isfinite(values).all(axis=1)
    if not usable.any():
        return None
    most = int(sizes[usable].max())
    values[sizes != most] = math.nan
    compared = np.asarray(np.isfinite(values).all(axis=1))
    values[_behind(np.array([o.rank_cm_s for o in history]), compared)] = math.nan
    worst, ideal = worst_values(config, chosen, values), ideal_values(chosen, values)
    box = np.maximum(worst - ideal, _LEAST)
    n = len(values)
    steps = sorted({math.ceil(n * k / _STEPS) for k in range(1, _STEPS + 1)})
    return Front(
        objectives=chosen,
        n_switches=most,
        values=values,
        worst=worst,
        candidates=tuple(int(i) for i in pareto_front(values)),
        growth=tuple((k, hypervolume(values[:k] - ideal, box)) for k in steps),
    )


def _behind(ranks: FloatArray, compared: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n,) who leaves more than `max_open` open, and is on no front; where all do, all but who leaves fewest open."""
    beyond = is_beyond(ranks)
    if not beyond[compared].all():
        return beyond
    return np.asarray(ranks > ranks[compared].min())


def print_front(path: str, objectives: Sequence[str]) -> None:
    """A row a candidate, then how the front grew. Raises CertifyError where nothing is usable yet."""
    from rich.table import Table

    campaign, front, records = _read(path, objectives)
    shown = Table(
        title=f"{path}: {' against '.join(front.objectives)}, {front.n_switches:,} switches",
        title_justify="left",
        show_lines=True,
    )
    shown.add_column("candidate", justify="right")
    shown.add_column("waveform")
    further = _further(front)
    names = [f"{name} [{quantity(name).unit}]" for name in further]
    for column in ("v_u [cm/s]", "mean V [cm/s]", "left open", "g [cm/s]", "closing time [µs]", "peak [V]", *names):
        shown.add_column(column, justify="right", no_wrap=True)
    for i in front.candidates:
        record = {name: column[i] for name, column in records.items()}
        ends = record["closing_lower_us"], record["closing_upper_us"]
        closing = with_interval(record["closing_us"], *ends, least_digits("µs"))
        rows = waveform_rows(campaign.waveform(i))
        shown.add_row(
            str(i),
            describe_waveform(rows),
            *metrics_row(record),
            closing,
            f"{_peak(campaign, i):.1f}",
            *(
                with_interval(
                    record[name], record[f"{name}_lower"], record[f"{name}_upper"], least_digits(quantity(name).unit)
                )
                for name in further
            ),
        )
    console = wide_console()
    console.print(shown)
    corner = ", ".join(
        f"{name} {sign_of(name) * worst:g} {unit_of(name)}".strip()
        for name, worst in zip(front.objectives, front.worst, strict=True)
    )
    said = ", ".join(f"{volume:.4f} after {k:,}" for k, volume in _quarters(front))
    console.print(f"hypervolume (1 = ideal), below {corner}: {said} candidates")


def _further(front: Front) -> list[str]:
    """Objectives that have a column of their own in the records."""
    return [name for name in front.objectives if name not in OF_THE_FRONT]


def unit_of(objective: str) -> str:
    """Unit of an objective; empty for a pure number."""
    return quantity(objective).unit.removeprefix("1")


def front_to_json(path: str, objectives: Sequence[str]) -> dict[str, Any]:
    """One object; undefined numbers are null. Raises CertifyError where nothing is usable yet."""
    campaign, front, records = _read(path, objectives)
    names = {
        "v_u_cm_s": ("v_u_lower_cm_s", "v_u_upper_cm_s"),
        "p_nc": ("p_nc_wilson_lower", "p_nc_wilson_upper"),
        "closing_us": ("closing_lower_us", "closing_upper_us"),
        "mean_cm_s": ("mean_lower_cm_s", "mean_upper_cm_s"),
        "g_cm_s": ("g_lower_cm_s", "g_upper_cm_s"),
    }
    rows = [
        {
            "candidate": i,
            **{name: float(records[name][i]) for name in names},
            **{f"{name}_interval": [float(records[end][i]) for end in ends] for name, ends in names.items()},
            "peak_volts": _peak(campaign, i),
            **{
                key: [float(records[end][i]) for end in (f"{name}_lower", f"{name}_upper")]
                if key.endswith("_interval")
                else float(records[name][i])
                for name in _further(front)
                for key in (name, f"{name}_interval")
            },
            "waveform": waveform_rows(campaign.waveform(i)),
        }
        for i in front.candidates
    ]
    found: dict[str, Any] = finite(
        {
            "store": path,
            "objectives": list(front.objectives),
            "n_switches": front.n_switches,
            "front": rows,
            "worst": {n: sign_of(n) * w for n, w in zip(front.objectives, front.worst.tolist(), strict=True)},
            "hypervolume": [{"candidates": k, "share": share} for k, share in front.growth],
        }
    )
    return found


def _read(path: str, objectives: Sequence[str]) -> tuple[Any, Front, dict[str, NDArray[Any]]]:
    campaign = open_campaign(path)
    records = dict(campaign.records())
    front = front_of(observations(records), CampaignConfig.from_dict(campaign.config), objectives)
    if front is None:
        raise CertifyError(f"{path} has no usable candidate yet: let the campaign run first")
    return campaign, front, records


def _peak(campaign: Any, i: int) -> float:
    from softclose.waveform import Waveform

    return Waveform.from_rows(campaign.waveform(i)).max_voltage(campaign.config["model"]["horizon_us"])


def _quarters(front: Front) -> list[tuple[int, float]]:
    last = len(front.growth)
    return [front.growth[math.ceil(last * k / 4) - 1] for k in (1, 2, 3, 4)]
