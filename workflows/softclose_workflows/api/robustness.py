"""Owns, from Python, how a stored waveform fares when lot or drive are not as assumed: tails, drift, propagate."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING

from softclose_store import open_campaign
from softclose_workflows.analyses.chosen import Chosen
from softclose_workflows.api.placing import crew_of
from softclose_workflows.api.results import Result, Store, metrics, path_text

if TYPE_CHECKING:
    from softclose.uncertainty.devices import Propagated
    from softclose.uncertainty.drift import Drift, DriftKind
    from softclose.uncertainty.tails import Method, Tail
    from softclose_workflows.analyses.tails import Question


def tails(
    store: Store,
    limits_cm_s: Sequence[float] = (),
    *,
    left_open: bool = False,
    methods: Sequence[Method] = (),
    n_switches: int = 1_000_000,
    candidate: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Result[list[tuple[Question, tuple[Tail, ...]]]]:
    """Estimate rare failures of a stored waveform, as `softclose tails`.

    Parameters
    ----------
    store
        Path, URL, or what `run` returned.
    limits_cm_s
        Speeds that a failure exceeds [cm/s]; by default the campaign's.
    left_open
        Ask for switches that stay open, too.
    methods
        By default all that are installed.
    n_switches
        Of brute force.
    candidate
        By default the best certified one.
    workers, scheduler
        Processes of a local cluster, or the address of a Dask scheduler, in the place of threads.

    Returns
    -------
    Result
        One row an answer.
    """
    from softclose.settings import CampaignConfig
    from softclose.uncertainty.tails import METHODS
    from softclose_workflows.analyses.tails import questions
    from softclose_workflows.analyses.tails import tails as analyse

    path = path_text(store)
    config = CampaignConfig.from_dict(open_campaign(path).config)
    with crew_of(workers, scheduler) as crew:
        chosen, found = analyse(
            path,
            questions(limits_cm_s or config.objective.limits_cm_s, left_open),
            candidate=candidate,
            methods=methods or (METHODS if find_spec("openturns") else METHODS[:1]),
            n_switches=n_switches,
            mapper=crew,
        )
    rows = [
        {
            "failure": question.words,
            "method": t.method,
            "probability": t.probability,
            "lower": t.interval[0],
            "upper": t.interval[1],
            "switches": t.n_switches,
            "note": t.note,
        }
        for question, answers in found
        for t in answers
    ]
    return Result(value=found, title=_title(path, chosen, "rare failures"), rows=rows)


def drift(
    store: Store,
    kind: DriftKind = "stiffness",
    values: Sequence[float] = (),
    *,
    n_switches: int = 20_000,
    candidate: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Result[Drift]:
    """Show how far pull-in voltages may drift, as `softclose drift`; `plot()` draws v_u and the share left open.

    Parameters
    ----------
    store
        Path, URL, or what `run` returned.
    kind
        What drifts: charge [V], or stiffness (a relative change of the pull-in voltage).
    values
        Drifts to look at; by default some parts of the mean switch's pull-in voltage.
    n_switches
        New switches.
    candidate
        By default the best certified one.
    workers, scheduler
        Processes of a local cluster, or the address of a Dask scheduler, in the place of threads.

    Returns
    -------
    Result
        One row a drift.
    """
    from softclose_workflows.analyses.drift import drift as analyse
    from softclose_workflows.analyses.drift import sentences
    from softclose_workflows.figures.drifting import draw_drift

    path = path_text(store)
    with crew_of(workers, scheduler) as crew:
        chosen, found = analyse(path, kind, values, candidate=candidate, n_switches=n_switches, mapper=crew)
    rows = [{"drift": r.drift, **metrics(r.assessment)} for r in found.rows]
    title = _title(path, chosen, f"pull-in voltages drifting by {kind}")
    return Result(
        value=found, title=title, rows=rows, notes=tuple(sentences(found)), figure=lambda: draw_drift(found, title)
    )


def propagate(
    store: Store,
    measurements: str | os.PathLike[str],
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    n_lots: int = 200,
    n_switches: int = 4_000,
    seed: int = 0,
    candidate: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Result[Propagated]:
    """Show how certain figures are, given how few devices the lot was fitted to, as `softclose propagate`.

    Parameters
    ----------
    store
        Path, URL, or what `run` returned.
    measurements
        The CSV file of the measured devices.
    bounds
        Known bounds of variables, such as `{"D": (2.3, 2.7)}` [µm].
    n_lots
        Lots that the devices may have come from.
    n_switches
        Switches that judge the waveform on each.
    seed
        Of the lots.
    candidate
        By default the best certified one.
    workers, scheduler
        Processes of a local cluster, or the address of a Dask scheduler, in the place of threads.

    Returns
    -------
    Result
        One row a figure: its value, its interval by switches, its interval by devices.
    """
    from softclose_workflows.analyses.devices import propagate as run

    path = path_text(store)
    with crew_of(workers, scheduler) as crew:
        chosen, found, notes = run(
            path,
            os.fspath(measurements),
            columns={},
            candidate=candidate,
            bounds=dict(bounds or {}),
            n_lots=n_lots,
            n_switches=n_switches,
            seed=seed,
            mapper=crew,
        )
    a = found.assessment
    figures = {
        "v_u_cm_s": (a.v_u_cm_s, a.v_u_interval),
        "p_nc": (a.p_nc, a.p_nc_intervals.wilson),
        "g_cm_s": (a.g_cm_s, a.g_interval),
    }
    rows = []
    for name, (value, by_switches) in figures.items():
        low, high = found.interval(name)
        ends = {"lower by devices": low, "upper by devices": high}
        rows.append(
            {"figure": name, "value": value, "lower by switches": by_switches[0], "upper by switches": by_switches[1]}
            | ends
        )
    title = _title(path, chosen, f"on lots that {found.n_devices} devices may have come from")
    return Result(value=found, title=title, rows=rows, notes=tuple(notes))


def _title(path: str, chosen: Chosen, what: str) -> str:
    return f"{path}, candidate {chosen.candidate} ({chosen.why}): {what}"
