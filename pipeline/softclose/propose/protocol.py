"""Owns the protocol between a campaign and whoever proposes its waveforms, and loads engines by name.

A wave is proposed together. Its candidates are a pure function of (configuration, wave, the records of the waves that
it sees, the waveforms of those between): no engine keeps state between calls but as a cache that may be dropped, so
any process gives the same answer.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from softclose.conditions.trim import trim_of
from softclose.device.told import mean_switch
from softclose.evaluate.chain import chain_of
from softclose.plugins import ENGINES, load_object
from softclose.plugins import EngineError as EngineError
from softclose.propose.promises import Basins, PriorHelp, PriorValues
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose.waveform.spaces import NaturalScales, Space, build_space

if TYPE_CHECKING:
    from softclose.population import Population
    from softclose.propose.swing import FewSwitches


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """One committed candidate, as the store holds it."""

    index: int
    """Position in the campaign."""
    wave: int
    """Wave that it belongs to."""
    waveform: Waveform
    """What was applied."""
    origin: str
    """Who proposed it: `Proposal.origin`, or "initial" for a waveform of the user's own."""
    n_switches: int
    """Switches that it was evaluated on."""
    g_cm_s: float
    """Objective [cm/s]; NaN where failed."""
    g_se_cm_s: float
    """Standard error of g from the finite ensemble [cm/s]; NaN where undefined."""
    v_u_cm_s: float
    """Upper velocity, Eqs. 8-9 [cm/s]; NaN where undefined."""
    mean_cm_s: float
    """Mean contact speed [cm/s]; NaN where undefined."""
    p_nc: float
    """Fraction not closed at the horizon."""
    p_contact: float
    """Fraction that touched."""
    failed: bool
    """True where no usable result exists; engines learn nothing from it but its place."""
    rank_cm_s: float
    """What engines minimise: `softclose.metrics.ranking`; NaN where failed."""
    closing_us: float = math.nan
    """Closing time of the lot [µs]; inf where too many stay open, NaN where it is not known."""
    beliefs: Mapping[str, float] = field(default_factory=dict)
    """What its proposal said of the surrogate: `Proposal.surrogate`."""
    quantities: Mapping[str, float] = field(default_factory=dict)
    """Those further quantities that the campaign asks for, by name."""

    @property
    def usable(self) -> bool:
        """True where it has a rank."""
        return not self.failed and math.isfinite(self.rank_cm_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """The next candidate."""

    waveform: Waveform
    """Admissible by construction: the search space repairs what is not."""
    origin: str
    """One short word for the store; those of the shipped engines are in `origins`."""
    n_switches: int
    """Switches to evaluate it on: those of its wave."""
    surrogate: dict[str, float] = field(default_factory=dict)
    """What the surrogate predicted (prediction, length scales, noise, trust region); {} for engines without one."""
    note: str = ""
    """Why something unusual was done, e.g. a fallback; empty as a rule."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wave:
    """Candidates that are proposed, simulated and committed together; `plan` says which there are."""

    index: int
    """Position among the campaign's waves."""
    stage: str
    """search, explore, finish, or extend1, extend2, …"""
    start: int
    """Index of its first candidate in the campaign."""
    size: int
    """Number of candidates."""
    n_switches: int
    """Switches that its candidates are evaluated on."""
    sees: int
    """Its proposals see the records of the waves 0 … sees - 1, and the waveforms of the waves sees … index - 1."""

    @property
    def stop(self) -> int:
        """One past the index of its last candidate."""
        return self.start + self.size


_IN_PROCESS = "softclose.propose.prior_basins:InProcess"
"""Who answers for a prior where nobody helps: by name, since descents on a prior are problems themselves."""


@dataclass(frozen=True)
class Problem:
    """Everything an engine may know; all of it follows from the configuration."""

    config: CampaignConfig
    help: PriorHelp | None = field(default=None, compare=False, repr=False)
    """Who knows of the prior what follows from the configuration too; None: it is worked out here."""

    @cached_property
    def population(self) -> Population:
        """The population, from the configuration's own description."""
        return self.config.build_population()

    @cached_property
    def space(self) -> Space:
        """The search space, scaled by the population's mean switch."""
        config = self.config
        scales = NaturalScales.from_switch(
            mean_switch(self.population, chain_of(self.config).device),
            plate_area_um2=config.model.plate_area_um2,
            max_volts=config.waveform.max_volts,
            min_rise_us=config.waveform.min_rise_us,
            horizon_us=config.model.horizon_us,
        )
        return build_space(config.waveform.space, scales)

    @cached_property
    def lot(self) -> FewSwitches:
        """The few switches whose free swing the engines may look at."""
        from softclose.propose.swing import FewSwitches  # imported where it is used: the compiler is slow to import

        trim = self.config.trim
        return FewSwitches.of(
            self.population,
            chain_of(self.config).device,
            trim=None if trim.measured == "nothing" else trim_of(trim, chain_of(self.config).around),
        )

    @cached_property
    def design_blocks(self) -> dict[tuple[str, int, int], NDArray[np.float64]]:
        """Blocks of the design by stream, number and turn, as far as asked for: a cache of a pure function."""
        return {}

    @cached_property
    def descents(self) -> dict[Hashable, Any]:
        """The latest state of every descent: a cache, see `descents.continued`."""
        return {}

    @cached_property
    def known(self) -> dict[Hashable, Any]:
        """What was worked out of records before: a cache, see `softclose.propose.known`."""
        return {}

    @cached_property
    def basins(self) -> Basins | None:
        """The basins of the prior; None without a prior."""
        if not self.config.has_prior:
            return None
        return self._asked.basins()

    @cached_property
    def _asked(self) -> PriorHelp:
        help_: PriorHelp = load_object(_IN_PROCESS)(self.config) if self.help is None else self.help
        return help_

    def prior_values(self, waveforms: Sequence[Waveform], n_switches: int | None = None) -> PriorValues:
        """The prior's g of each waveform.

        Parameters
        ----------
        waveforms : sequence of Waveform
            Within the campaign's voltage limit.
        n_switches : int, optional
            How many of the prior's switches, by default all.

        Returns
        -------
        PriorValues
            NaN where the prior's model has no answer.

        Raises
        ------
        PriorError
            Where the machine is at fault.
        """
        return self._asked.values(waveforms, n_switches)

    @property
    def n_initial_waveforms(self) -> int:
        """Number of the user's own waveforms at the head of the campaign."""
        return len(self.config.waveform.initial)

    def generator(self, stream: str, index: int) -> np.random.Generator:
        """Random numbers keyed by (campaign.seed, stream, index): never drawn from a shared generator.

        Parameters
        ----------
        stream : str
            What they are for.
        index : int
            Which of them.
        """
        key = int.from_bytes(stream.encode()[:8].ljust(8, b"\0"), "big")
        return np.random.default_rng(np.random.SeedSequence([self.config.campaign.seed, key, index]))


@runtime_checkable
class Engine(Protocol):
    """Whoever proposes waveforms one at a time. Its waves have `campaign.wave` candidates."""

    def propose(
        self, problem: Problem, index: int, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> Proposal:
        """The next candidate. Pure: the same arguments give bit-identical results.

        Parameters
        ----------
        problem : Problem
            What is optimised.
        index : int
            Index of the candidate.
        history : sequence of Observation
            Records in order of index, ending with the last wave that is seen.
        pending : sequence of Waveform
            The waveforms of the candidates between, those earlier in the same wave included.

        Returns
        -------
        Proposal
        """
        ...


@runtime_checkable
class WaveEngine(Protocol):
    """Whoever proposes waveforms a wave at a time.

    One whose attribute `is_blind` is true says that its proposals follow from the configuration alone: several of its
    waves are in flight at once.
    """

    def wave_sizes(self, problem: Problem, budget: int) -> Sequence[int]:
        """Sizes of its waves, from the configuration alone.

        The user's own waveforms take the first places of a search, and the engine is asked for the others.

        Parameters
        ----------
        problem : Problem
            What is optimised.
        budget : int
            Candidates in all.

        Returns
        -------
        sequence of int
            Adding up to `budget`.
        """
        ...

    def propose_wave(
        self, problem: Problem, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> Sequence[Proposal]:
        """The candidates of a wave. Pure, as `Engine.propose`.

        Parameters
        ----------
        problem : Problem
            What is optimised.
        wave : Wave
            Its first candidate and size.
        history, pending
            See `Engine.propose`.

        Returns
        -------
        sequence of Proposal
            `wave.size` of them, from candidate `wave.start` on.
        """
        ...


_STAGES = {
    "explore": "softclose.propose.explore:ExploreEngine",
    "finish": "softclose.propose.finish:FinishEngine",
    "extend": "softclose.propose.extend:ExtendEngine",
    "retry": "softclose.propose.retry:RetryEngine",
}


def load_engine(name: str) -> Engine | WaveEngine:
    """The engine of that name, or of the stages explore, finish and extend (an instance); imports only that engine.

    Raises EngineError naming the nearest one.
    """
    loaded = load_object(_STAGES[name]) if name in _STAGES else ENGINES.load(name)
    return cast("Engine | WaveEngine", loaded() if isinstance(loaded, type) else loaded)


def even_waves(budget: int, each: int, first: int = 0) -> list[int]:
    """Sizes of waves of `each` candidates and what is left, from candidate `first` on, until there are `budget`."""
    return [min(each, budget - begin) for begin in range(first, budget, each)]


def seen_by(wave: Wave, history: Sequence[Observation]) -> Sequence[Observation]:
    """The records that a wave may see, however many more have come in."""
    return history[: bisect_left(history, wave.sees, key=lambda o: o.wave)]


def search_history(problem: Problem, history: Sequence[Observation]) -> list[Observation]:
    """The records of the search itself, without those of the stages after it."""
    return [o for o in history if o.index < problem.config.campaign.budget]
