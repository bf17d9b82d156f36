"""Owns certification by a race: the best candidates on new switches, no more of them than it takes to tell.

The finalists of the race, and the incumbent, are then certified on the switches that it ended at: the certificate is
what `softclose certify --switches` of that size would have written for them.
"""

from __future__ import annotations

import math
from dataclasses import replace

from softclose.evaluate import objective_settings
from softclose.evaluate.pieces import Mapper, here, joined_judged
from softclose.metrics.objective import Judged
from softclose.metrics.race import Race, race, sizes
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import open_campaign
from softclose_workflows.analyses.certificates import write_certificate
from softclose_workflows.analyses.certification import Certification, CertifyError, Request, candidate_name
from softclose_workflows.analyses.certify import (
    N_REFERENCES,
    certified_on,
    check_size,
    choose_distinct,
    drawn_fresh,
    keep_certificate,
    least_switches,
    simulate_fresh,
)
from softclose_workflows.analyses.kept_certificates import KeptDesign, keep_designs
from softclose_workflows.analyses.references import reference_designs
from softclose_workflows.run import needs
from softclose_workflows.tell.console import OnStep

LEAST = 1_000
"""Switches of the first round, where the campaign itself does not ask for more."""


def certify_within(
    path: str,
    tolerance_cm_s: float,
    *,
    n_switches: int = 100_000,
    seed: int | None = None,
    top: int = 10,
    store_trajectories: bool = False,
    mapper: Mapper = here,
    listener: OnStep | None = None,
) -> tuple[Certification, Race]:
    """Certify the finalists of a race between the `top` best distinct candidates, and keep the result in the store.

    The race ends when no candidate left can beat the best by more than tolerance_cm_s, or at n_switches. The
    race's numbers are those of the candidates. store_trajectories: those of every candidate on all switches that it ran
    on, simulated again for it, and those of the certificate are kept, too. Raises CertifyError.
    """
    if isinstance(tolerance_cm_s, bool) or not 0.0 < tolerance_cm_s < math.inf:
        raise CertifyError(f"the tolerance is {tolerance_cm_s!r} cm/s; it must be above 0 (--within), such as 0.05")
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    check_size(config, n_switches, top)
    seed = config.campaign.seed if seed is None else seed
    incumbent, chosen = choose_distinct(campaign, config, top)
    kept = config if store_trajectories else None
    needs.check_fresh(n_switches, len(chosen) + N_REFERENCES, path=path, kept=kept)
    waveforms = [Waveform.from_rows(campaign.waveform(i)) for i in chosen]
    track = _Track(config, waveforms, seed, mapper)
    rounds = sizes(max(least_switches(config), LEAST), n_switches)

    def respond(i: int, n: int) -> Judged:
        if listener is not None:
            listener(track.n_done, len(chosen) * n_switches)
        return track.respond(i, n)

    if config.objective.weights or config.objective.quantity_limits:
        raise CertifyError(
            "a race compares v_u and p_nc switch by switch, and this campaign's g weighs further quantities "
            "(objective.weights, objective.quantity_limits): certify without --within"
        )
    objective = objective_settings(config) | {"sampling": "monte-carlo"}
    result = race(len(chosen), rounds, respond, tolerance_cm_s=tolerance_cm_s, **objective)
    last = result.laps[-1].n_switches
    candidates = sorted({*(chosen[i] for i in result.finalists), incumbent})
    request = Request(
        n_switches=last,
        seed=seed,
        top=len(candidates),
        committed=campaign.committed,
        incumbent=incumbent,
        candidates=tuple(candidates),
        missing=reference_designs(config).missing,
    )
    have = {candidate_name(i): track.respond(chosen.index(i), last) for i in candidates}
    certification = certified_on(campaign, config, request, have, mapper=mapper)
    write_certificate(path, certification, drawn_fresh(config, last, seed=seed, mapper=mapper))
    if store_trajectories:
        ran = [
            KeptDesign(name=candidate_name(i), waveform=waveform, n_switches=track.n_of(k))
            for k, (i, waveform) in enumerate(zip(chosen, waveforms, strict=True))
        ]
        keep_designs(path, config, ran, seed=seed, mapper=mapper, listener=listener)
        keep_certificate(path, config, certification, mapper=mapper, listener=listener)
    return certification, _named(result, chosen)


def _named(result: Race, chosen: list[int]) -> Race:
    """The race with the campaign's numbers of the candidates in place of their places in it."""

    def names(places: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(chosen[i] for i in places)

    laps = (replace(lap, racing=names(lap.racing), best=chosen[lap.best], out=names(lap.out)) for lap in result.laps)
    return replace(result, laps=tuple(laps))


class _Track:
    """What the waveforms have done so far: each runs on the switches that it has not run on yet."""

    def __init__(self, config: CampaignConfig, waveforms: list[Waveform], seed: int, mapper: Mapper) -> None:
        self._config, self._waveforms, self._seed, self._mapper = config, waveforms, seed, mapper
        self._done: dict[int, Judged] = {}

    @property
    def n_done(self) -> int:
        """Trajectories simulated."""
        return sum(found.closed.size for found in self._done.values())

    def n_of(self, i: int) -> int:
        """Switches that waveform i has run on."""
        return self._done[i].closed.size

    def respond(self, i: int, n: int) -> Judged:
        """Waveform i on the first n switches."""
        have = self._done.get(i)
        start = 0 if have is None else have.closed.size
        if start < n:
            more = simulate_fresh(
                self._config,
                [self._waveforms[i]],
                n_switches=n - start,
                seed=self._seed,
                start=start,
                mapper=self._mapper,
            )[0]
            have = self._done[i] = more if have is None else joined_judged([have, more])
        assert have is not None
        return have
