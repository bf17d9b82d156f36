"""Owns the way from a store to `ReportData`: what is read, what is computed beside it, how much a page can carry."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softclose.config import CampaignConfig
from softclose.objective import CM_S, assess
from softclose.propose.dependence import Dependence, surrogate_dependence
from softclose.propose.protocol import Observation, Problem
from softclose.waveform import FloatArray, Waveform
from softclose_workflows.certify import read_certification, reference_designs
from softclose_workflows.records import objective_settings, observations
from softclose_workflows.report.data import DESIGN_NAMES, Candidates, Design, ReportData, Traces

if TYPE_CHECKING:
    from softclose_store import Campaign

N_BEST_TRACES = 150
"""Switches of the best candidate whose motion is drawn: more of them only make the picture darker."""

MAX_PICKS = 250
"""Candidates that a reader may pick; of a longer campaign those of smallest g."""

ENDS = ("_lower", "_upper", "_lower_cm_s", "_upper_cm_s")
"""How columns end that are ends of intervals."""

_PICK_SAMPLES = 450_000
"""Samples of x and v carried for all picks together: 1.2 MB of page."""


def gather(path: str, *, learned: bool = True, picks: bool = True) -> ReportData:
    """Read one store, growing or finished. Raises the store's own errors where there is none.

    learned: fit a surrogate for the partial dependence. picks: also read a sample of every candidate's motion.
    """
    from softclose_store import open_campaign

    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    records = campaign.records()
    candidates = _candidates(records, config)
    best, certification = campaign.best(), read_certification(path)
    index = None if best is None else best.candidate
    if certification is not None:
        index = certification.best.candidate
    chosen = _picks(candidates, index) if picks else []
    speeds: list[FloatArray] = [np.empty(0)] * len(candidates)
    for i in chosen:
        speeds[i] = np.asarray(campaign.responses(i).max_contact_speed) * CM_S
    parameters = {name: np.asarray(values) for name, values in campaign.population().items()}
    return ReportData(
        source=PurePosixPath(str(path).rstrip("/")).name,
        config=config,
        fingerprint=campaign.fingerprint,
        runtime=campaign.runtime,
        n_total=campaign.budget,
        candidates=candidates,
        best=index,
        parameters=parameters,
        designs=_designs(campaign, config, index),
        speeds_cm_s=tuple(speeds),
        samples=_samples(campaign, config, chosen) if picks else {},
        dependence=_dependence(config, observations(records)) if learned else None,
        certification=certification,
    )


def _candidates(records: Mapping[str, NDArray[Any]], config: CampaignConfig) -> Candidates:
    n = len(records["failed"])
    columns = {
        name: np.asarray(values, dtype=np.float64)
        for name, values in records.items()
        if values.ndim == 1 and values.dtype.kind == "f"
    }
    for k, limit in enumerate(config.objective.limits_cm_s):
        for name, end in (("p_exceed", ""), ("p_exceed_wilson", "_lower"), ("p_exceed_wilson", "_upper")):
            columns[f"{name}_{limit:g}{end}"] = np.asarray(records[name + end][:, k], dtype=np.float64)
    if config.population.sampling != "monte-carlo":  # recorded for any sampling, but none holds for quasi-random draws
        columns = {n: np.full_like(v, math.nan) if n.endswith(ENDS) else v for n, v in columns.items()}
    names = records["surrogate_name"]
    surrogate = {}
    for name in sorted({str(v) for v in names.ravel()} - {""}):
        at = names == name
        values = np.where(at, records["surrogate"], 0.0).sum(axis=1)
        surrogate[name] = np.where(at.any(axis=1), values, math.nan)
    notes = [str(note) or str(failure) for note, failure in zip(records["note"], records["failure"], strict=True)]
    return Candidates(
        waveforms=tuple(_waveform(records["waveform"][i]) for i in range(n)),
        origin=tuple(str(v) for v in records["origin"]),
        note=tuple(notes),
        failed=np.asarray(records["failed"], dtype=np.bool_),
        n_switches=np.asarray(records["n_switches"], dtype=np.int64),
        columns=columns,
        surrogate=surrogate,
    )


def _waveform(rows: FloatArray) -> Waveform | None:
    return None if np.isnan(rows).all() else Waveform.from_rows(rows)


def _picks(candidates: Candidates, best: int | None) -> list[int]:
    """Candidates that a reader may pick, in order of their index."""
    usable = np.flatnonzero(~candidates.failed & np.isfinite(candidates.columns["g_cm_s"]))
    order = usable[np.argsort(candidates.columns["g_cm_s"][usable], kind="stable")][:MAX_PICKS]
    return sorted({int(i) for i in order} | ({best} if best is not None else set()))


def _traces(campaign: Campaign, i: int, n: int, step: int) -> Traces | None:
    """The first n switches: the ensemble's order is random, so they are a fair sample."""
    if not len(campaign.times_us):
        return None
    motion, responses = campaign.trajectories(i), campaign.responses(i)
    n = min(n, len(motion.x))
    travel = campaign.population()["D"][:n, None]
    impacts = responses.impact_time_us, responses.impact_speed
    none = np.empty((n, 0))
    return Traces(
        rows=np.arange(n),
        times_us=motion.times_us[::step],
        distance_um=travel - np.asarray(motion.x[:n, ::step], dtype=np.float64),
        velocity_cm_s=np.asarray(motion.v[:n, ::step], dtype=np.float64) * CM_S,
        impact_us=none if impacts[0] is None else impacts[0][:n],
        impact_cm_s=none if impacts[1] is None else impacts[1][:n] * CM_S,
    )


def _step(n_times: int, most: int) -> int:
    return max(1, math.ceil((n_times - 1) / most))


def _samples(campaign: Campaign, config: CampaignConfig, chosen: list[int]) -> dict[int, Traces]:
    """Fewer switches and fewer instants of each candidate, so that the page stays small however long the campaign."""
    if not chosen:
        return {}
    step = _step(config.store.n_times, 200)
    n = int(np.clip(_PICK_SAMPLES / (2.0 * len(chosen) * max(config.store.n_times // step, 1)), 3, 40))
    traces = {i: _traces(campaign, i, n, step) for i in chosen}
    return {i: t for i, t in traces.items() if t is not None}


def _designs(campaign: Campaign, config: CampaignConfig, best: int | None) -> tuple[Design, ...]:
    """The best candidate, and the two reference designs on the same switches."""
    from softclose_workflows.respond import respond

    if best is None:
        return ()
    settings = objective_settings(config)
    responses = campaign.responses(best)
    n = len(responses.max_contact_speed)
    designs = [
        Design(
            name="best candidate", waveform=Waveform.from_rows(campaign.waveform(best)),
            speed_cm_s=responses.max_contact_speed * CM_S, closed=responses.closed,
            assessment=assess(responses, **settings),
            traces=_traces(campaign, best, N_BEST_TRACES, _step(config.store.n_times, 500)),
        )
    ]  # fmt: skip
    switches = campaign.switches()[:n]
    for name, waveform in reversed(reference_designs(config).items()):
        r = respond(config.model, config.compute, switches, waveform)
        designs.append(Design(name=DESIGN_NAMES[name], waveform=waveform, speed_cm_s=r.max_contact_speed * CM_S,
                              closed=r.closed, assessment=assess(r, **settings)))  # fmt: skip
    return tuple(designs)


def _dependence(config: CampaignConfig, history: list[Observation]) -> Dependence | None:
    return surrogate_dependence(Problem(config), history)
