"""Owns the way from a store to `ReportData`: what is read, what is computed beside it, how much a page can carry."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.evaluate.pieces import Mapper, here
from softclose.metrics.objective import CM_S
from softclose.population.lot import Lot
from softclose.propose.dependence import Dependence, surrogate_dependence
from softclose.propose.origins import NSGA2
from softclose.propose.protocol import Observation, Problem
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store.schema.fields import SURROGATE_PREFIX
from softclose_workflows.analyses.certify import read_certification
from softclose_workflows.analyses.distinct import APART_V, distinct, last_change_us
from softclose_workflows.analyses.front import Front, front_of
from softclose_workflows.analyses.references import simulate_references
from softclose_workflows.report.data import (
    BEST,
    Candidates,
    Design,
    ReportData,
    Traces,
    reference_name,
)
from softclose_workflows.report.section import Given
from softclose_workflows.report.sections import found_in
from softclose_workflows.report.shapes import shares, speed_edges
from softclose_workflows.run.controlled import judge_as
from softclose_workflows.run.records import observations
from softclose_workflows.tell import labels
from softclose_workflows.tell.standing import changes_of

if TYPE_CHECKING:
    from softclose_store import Campaign, StoredResponses

N_BEST_TRACES = 100
"""Switches of the best candidate whose motion is drawn: more of them only make the picture darker."""

MAX_PLACES = 12
"""Different places of the search, or places on a front, whose switches' motion a page carries."""

_PICK_SAMPLES = 50_000
"""Samples of x and v carried for all picks together: 0.13 MB of page."""


def gather(path: str, *, learned: bool = True, picks: bool = True, mapper: Mapper = here) -> ReportData:
    """Read one store, growing or finished. Raises the store's own errors where there is none.

    learned: fit a surrogate for the partial dependence. picks: also read a sample of every candidate's motion. mapper:
    who simulates the reference designs.
    """
    from softclose_store import open_campaign

    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    records = campaign.records()
    history = observations(records)
    candidates = _candidates(records, config)
    best, certification = campaign.best(), read_certification(path)
    index = None if best is None else best.candidate
    if certification is not None:
        index = certification.best.candidate
    front = front_of(history, config)
    places = _places(candidates, index, config, front) if picks else () if index is None else (index,)
    chosen = sorted(places)
    edges = speed_edges(float(np.fmax.reduce(candidates.columns["max_cm_s"][chosen], initial=0.0)))
    designs, missing = _designs(campaign, config, index, mapper)
    found: dict[str, Any] = {}
    if index is not None:
        found = found_in(
            Given(
                path=path,
                campaign=campaign,
                config=config,
                best=index,
                designs=designs,
                certification=certification,
            )
        )
    shares, samples = _read_picks(campaign, config, chosen, edges)
    return ReportData(
        source=PurePosixPath(str(path).rstrip("/")).name,
        config=config,
        fingerprint=campaign.fingerprint,
        runtime=campaign.runtime,
        n_total=campaign.budget,
        candidates=candidates,
        best=index,
        parameters={
            name: column
            for name in labels.PARAMETERS
            if (column := campaign.population().get(name)) is not None  # E and T are of a plate
        },
        designs=designs,
        missing_references=missing,
        sections=found,
        front=front,
        places=places,
        edges_cm_s=edges,
        shares=shares,
        samples=samples if picks else {},
        dependence=_dependence(config, history) if learned else None,
        certification=certification,
        changes=changes_of(campaign),
    )


def _candidates(records: Mapping[str, NDArray[Any]], config: CampaignConfig) -> Candidates:
    n = len(records["failed"])
    columns = {
        name: np.asarray(values, dtype=np.float64)
        for name, values in records.items()
        if values.ndim == 1 and values.dtype.kind == "f" and not name.startswith(SURROGATE_PREFIX)
    }
    for k, limit in enumerate(config.objective.limits_cm_s):
        for name, end in (("p_exceed", ""), ("p_exceed_wilson", "_lower"), ("p_exceed_wilson", "_upper")):
            columns[f"{name}_{limit:g}{end}"] = np.asarray(records[name + end][:, k], dtype=np.float64)
    surrogate = {
        name.removeprefix(SURROGATE_PREFIX): np.asarray(values, dtype=np.float64)
        for name, values in sorted(records.items())
        if name.startswith(SURROGATE_PREFIX)
    }
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


def _places(candidates: Candidates, best: int | None, config: CampaignConfig, front: Front | None) -> tuple[int, ...]:
    """The best candidate, then the best of each other place of the search; of a campaign for a front, along it."""
    if best is None:
        return ()
    if front is not None and config.optimiser.engine == NSGA2:
        along = sorted(front.candidates, key=lambda i: front.values[i, 0])
        spread = {round(k * (len(along) - 1) / (MAX_PLACES - 1)) for k in range(MAX_PLACES)} if along else set()
        return (best, *(along[k] for k in sorted(spread) if along[k] != best))
    usable = ~candidates.failed & np.isfinite(candidates.columns["g_cm_s"])
    kept = candidates.waveforms[best]
    assert kept is not None

    def waveform_of(i: int) -> Waveform:
        return candidates.waveforms[i] or kept

    order = [best, *(i for i in candidates.ranked if usable[i] and i != best)]
    until = last_change_us(kept, config.model.horizon_us)
    return tuple(distinct(order, waveform_of, until_us=until, apart_V=APART_V, most=MAX_PLACES))


def _traces(campaign: Campaign, i: int, responses: StoredResponses, travel_um: FloatArray, step: int) -> Traces | None:
    """The first switches, as many as travels are given: the ensemble's order is random, so they are a fair sample."""
    if not len(campaign.times_us):
        return None
    motion = campaign.trajectories(i)
    n = min(len(travel_um), len(motion.x))
    times, speeds = responses.impact_time_us, responses.impact_speed
    return Traces(
        rows=np.arange(n),
        times_us=motion.times_us[::step],
        distance_um=travel_um[:n, None] - np.asarray(motion.x[:n, ::step], dtype=np.float64),
        velocity_cm_s=np.asarray(motion.v[:n, ::step], dtype=np.float64) * CM_S,
        closed=np.asarray(responses.closed[:n], dtype=np.bool_),
        impact_us=np.empty((n, 0)) if times is None else times[:n],
        impact_cm_s=np.empty((n, 0)) if speeds is None else speeds[:n] * CM_S,
    )


def _step(n_times: int, most: int) -> int:
    return max(1, math.ceil((n_times - 1) / most))


def _read_picks(
    campaign: Campaign, config: CampaignConfig, chosen: list[int], edges: FloatArray
) -> tuple[dict[int, FloatArray], dict[int, Traces]]:
    """Histogram and sampled motion of each: fewer switches in a longer campaign, so that the page stays small."""
    shares_of: dict[int, FloatArray] = {}
    samples: dict[int, Traces] = {}
    step = _step(config.store.n_times, 100)
    n = _PICK_SAMPLES / (2.0 * max(len(chosen), 1) * max(config.store.n_times // step, 1))
    travel = campaign.population()["D"][: int(np.clip(n, 3, 40))]
    for i in chosen:
        responses = campaign.responses(i)
        shares_of[i] = shares(responses.max_contact_speed * CM_S, edges)
        traces = _traces(campaign, i, responses, travel, step)
        if traces is not None:
            samples[i] = traces
    return shares_of, samples


def _designs(
    campaign: Campaign, config: CampaignConfig, best: int | None, mapper: Mapper
) -> tuple[tuple[Design, ...], dict[str, str]]:
    """The best candidate and the reference designs on the same switches; which of these are missing, and why."""
    if best is None:
        return (), {}
    responses, waveform = campaign.responses(best), Waveform.from_rows(campaign.waveform(best))
    n = len(responses.max_contact_speed)
    designs = [
        Design.of(
            responses,
            judge_as(campaign, waveform, responses),
            name=BEST,
            role="best",
            waveform=waveform,
            traces=_traces(
                campaign, best, responses, campaign.population()["D"][:N_BEST_TRACES], _step(config.store.n_times, 250)
            ),
        )
    ]
    references = simulate_references(config, Lot(campaign.population()).rows(slice(n)), mapper)
    for name, (reference, r) in reversed(references.responses.items()):
        found = judge_as(campaign, reference, r, for_everybody=True)
        designs.append(Design.of(r, found, name=reference_name(name, reference), role=name, waveform=reference))
    return tuple(designs), references.missing


def _dependence(config: CampaignConfig, history: list[Observation]) -> Dependence | None:
    return surrogate_dependence(Problem(config), history)
