"""Owns what an extension of a finished campaign is: a stage of its own, after all others.

A campaign that ended with its search goes on with the same engine, as if `campaign.budget` had been larger from here
on. One that ended with descents gets another (`extend`). What came before is not proposed again (ADR 056).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from softclose.propose.promises import Basins, PriorValues
from softclose.propose.protocol import Problem
from softclose.settings import CampaignConfig
from softclose.settings.campaign import extension_size
from softclose.waveform import Waveform

EXTEND, RETRY = "extend", "retry"
"""Stages `extend1`, `extend2`, …, and the engine of those that follow descents; that of candidates computed again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Extension:
    """One extension."""

    stage: str
    """Its stage."""
    begin: int
    """Index of its first candidate in the campaign."""
    size: int
    """Number of candidates."""
    engine: str
    """Who proposes."""
    n_switches: int
    """Switches that its candidates are evaluated on."""
    again: tuple[int, ...] = ()
    """Earlier candidates that are computed again, where that is what it is for."""

    @property
    def is_search(self) -> bool:
        """True where the campaign's own search goes on."""
        return self.engine not in (EXTEND, RETRY)


def extensions(config: CampaignConfig) -> dict[str, Extension]:
    """The extensions of a campaign by stage, in their order."""
    searches = not config.explore.budget + config.finish.budget
    begin = config.first_budget
    found = {}
    for number, what in enumerate(config.campaign.extensions, start=1):
        stage = f"{EXTEND}{number}"
        again = what if isinstance(what, tuple) else ()
        size = extension_size(what)
        found[stage] = Extension(
            stage=stage,
            begin=begin,
            size=size,
            engine=RETRY if again else config.optimiser.engine if searches else EXTEND,
            n_switches=config.n_switches_max,
            again=again,
        )
        begin += size
    return found


@dataclass(frozen=True, slots=True)
class _Shared:
    """The prior of a problem with another budget: it has the same."""

    problem: Problem

    def basins(self) -> Basins:
        """Those of the problem."""
        found = self.problem.basins
        assert found is not None
        return found

    def values(self, waveforms: Sequence[Waveform], n_switches: int | None = None) -> PriorValues:
        """Those of the problem."""
        return self.problem.prior_values(waveforms, n_switches)


def problem_of(problem: Problem, extension: Extension) -> Problem:
    """The problem as the engine of an extension sees it: a search that goes on has the larger budget."""
    if not extension.is_search:
        return problem
    campaign = replace(problem.config.campaign, budget=extension.begin + extension.size, extensions=())
    return Problem(replace(problem.config, campaign=campaign), help=_Shared(problem))
