"""Owns rescoring: the ranking of a campaign under another objective, from stored events and states alone.

Nothing is simulated: what a switch did under a waveform does not depend on how it is judged. A rescored candidate
equals a fresh simulation assessed the same way, bit for bit, because both go through `judged` and `assess`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.evaluate import judge
from softclose.metrics.objective import Assessment, Judged
from softclose.settings import CampaignConfig
from softclose_store import open_campaign


class RescoreError(ValueError):
    """A score that the stored events cannot give."""


class Events(Protocol):
    """What `judged` needs of a response: a fresh one or a stored one."""

    @property
    def max_contact_speed(self) -> FloatArray: ...
    @property
    def settling_us(self) -> FloatArray: ...
    @property
    def n_impacts(self) -> NDArray[np.int32]: ...
    @property
    def closed(self) -> NDArray[np.bool_]: ...
    @property
    def status(self) -> NDArray[np.int8]: ...
    @property
    def impact_time_us(self) -> Any: ...
    @property
    def impact_speed(self) -> Any: ...
    @property
    def asked(self) -> FloatArray | None: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """What is asked of the stored events."""

    objective: tuple[str, ...] = ()
    """Settings of the objective other than the campaign's, as `key=value`."""
    closed_by_us: float | None = None
    """A switch is closed where it is held from this instant, or earlier, to the horizon [µs]; None: at the horizon."""
    impacts: str = "all"
    """Which impacts count for V: all of Eq. 7, or the first only."""
    impacts_until_us: float | None = None
    """Only impacts until this instant count for V [µs]; None: until the horizon."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rescored:
    """One candidate under another score."""

    candidate: int
    """Its index."""
    rank: int
    """Place under the new score, from 1."""
    rank_before: int
    """Place under the campaign's own."""
    g_before_cm_s: float
    """g under the campaign's own [cm/s]."""
    n_switches: int
    """Switches that it was evaluated on."""
    assessment: Assessment
    """Eqs. 7-11 under the new score."""


def judged(response: Events, score: Score) -> Judged:
    """The response as the score sees it: which speed counts. Raises RescoreError."""
    speed = np.asarray(response.max_contact_speed)
    if score.impacts not in ("all", "first"):
        raise RescoreError(f"impacts is {score.impacts!r}; it must be all or first")
    if score.impacts == "first" or score.impacts_until_us is not None:
        speed = _counted(response, score)
    return Judged(
        max_contact_speed=speed,
        closed=np.asarray(response.closed, dtype=np.bool_),
        status=np.asarray(response.status),
        settling_us=np.asarray(response.settling_us),
        asked=response.asked,
    )


def _counted(response: Events, score: Score) -> FloatArray:
    """Largest speed of the impacts that count, (n,) [µm/µs]; NaN where none does."""
    if response.impact_time_us is None:
        raise RescoreError("no impact events are stored (store.max_impacts), so other impacts cannot be counted")
    time, speed = np.asarray(response.impact_time_us), np.asarray(response.impact_speed)
    until = math.inf if score.impacts_until_us is None else score.impacts_until_us
    if score.impacts == "first":
        time, speed = time[:, :1], speed[:, :1]
    else:
        kept = time.shape[1]
        last = time[:, -1]
        lost = (np.asarray(response.n_impacts) > kept) & ~(last > until)
        if lost.any():
            raise RescoreError(
                f"{int(lost.sum())} switches made more impacts until {until:g} µs than the {kept} that are stored: "
                "run the campaign with a larger store.max_impacts"
            )
    counted = np.where(time <= until, speed, -np.inf).max(axis=1)
    return np.where(np.isneginf(counted), np.nan, counted)


def rescored_config(config: CampaignConfig, score: Score) -> CampaignConfig:
    """The campaign's configuration with the score's objective; raises ConfigError for a bad one."""
    settings = [f"objective.{setting}" for setting in score.objective]
    if score.closed_by_us is not None:
        settings.append(f"objective.closed_by_us={score.closed_by_us}")
    return config.revised(settings)


def _check_instants(score: Score, horizon_us: float) -> None:
    for option, value in (("--closed-by", score.closed_by_us), ("--impacts-until", score.impacts_until_us)):
        if value is not None and not 0.0 < value <= horizon_us:
            raise RescoreError(
                f"{option} is {value:g} µs; the campaign simulated from 0 to {horizon_us:g} µs (model.horizon_us): "
                "give an instant in between"
            )


def rescore(path: str, score: Score) -> list[Rescored]:
    """Every usable candidate of a campaign under another score, best first.

    Ensembles of different sizes rank together here, as they were run: `n_switches` says which is which.
    """
    campaign = open_campaign(path)
    own = CampaignConfig.from_dict(campaign.config)
    _check_instants(score, own.model.horizon_us)
    config = rescored_config(own, score)
    table = campaign.records()
    usable = [int(i) for i in np.flatnonzero(~table["failed"] & np.isfinite(table["g_cm_s"]))]
    assessments = {}
    for i in usable:
        try:
            assessments[i] = judge(config, judged(campaign.responses(i), score))
        except RescoreError as e:
            raise RescoreError(f"candidate {i}: {e}") from e
    before = {i: rank for rank, i in enumerate(sorted(usable, key=lambda i: float(table["rank_cm_s"][i])), start=1)}
    order = sorted(usable, key=lambda i: assessments[i].rank_cm_s)
    return [
        Rescored(
            candidate=i,
            rank=rank,
            rank_before=before[i],
            g_before_cm_s=float(table["g_cm_s"][i]),
            n_switches=int(table["n_switches"][i]),
            assessment=assessments[i],
        )
        for rank, i in enumerate(order, start=1)
    ]
