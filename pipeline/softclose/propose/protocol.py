"""Owns the protocol between a campaign and whoever proposes its waveforms, and loads engines by name.

`propose` is a pure function of (configuration, index, records 0 … index-lag, waveforms in between): no engine keeps
state between calls, so nothing is replayed on resume and any process gives the same answer (DESIGN §2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from softclose.plugins import ENGINES, load_object
from softclose.plugins import EngineError as EngineError
from softclose.waveform import Waveform
from softclose.waveform.spaces import Scales, Space, build_space

if TYPE_CHECKING:
    from softclose.config import CampaignConfig
    from softclose.population import Population
    from softclose.propose.swing import Lot


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """One committed candidate, as the store holds it."""

    index: int
    """Position in the campaign."""
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

    @property
    def usable(self) -> bool:
        """True where g is a number."""
        return not self.failed and bool(np.isfinite(self.g_cm_s))


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """The next candidate."""

    waveform: Waveform
    """Admissible by construction: the search space repairs what is not."""
    origin: str
    """One short word for the store: sobol, trust-region, global, finish, fallback, …"""
    n_switches: int
    """Switches to evaluate it on."""
    surrogate: dict[str, float] = field(default_factory=dict)
    """What the surrogate believed (prediction, length scales, noise, trust region); {} for engines without one."""
    note: str = ""
    """Why something unusual was done, e.g. a fallback; empty as a rule."""


@dataclass(frozen=True)
class Problem:
    """Everything an engine may know; all of it follows from the configuration."""

    config: CampaignConfig

    @cached_property
    def population(self) -> Population:
        """The population, from the configuration's own description."""
        return self.config.build_population()

    @cached_property
    def space(self) -> Space:
        """The search space, scaled by the population's mean switch."""
        config = self.config
        scales = Scales.from_switch(
            np.asarray(self.population.mean_switch, dtype=np.float64),
            plate_area_um2=config.model.plate_area_um2,
            max_volts=config.waveform.max_volts,
            min_rise_us=config.waveform.min_rise_us,
            horizon_us=config.model.horizon_us,
        )
        return build_space(config.waveform.space, scales)

    @cached_property
    def lot(self) -> Lot:
        """The few switches whose free swing the engines may look at."""
        from softclose.propose.swing import Lot  # imported where it is used: the compiler is slow to import

        return Lot.of(self.population, plate_area_um2=self.config.model.plate_area_um2)

    @cached_property
    def design_blocks(self) -> dict[tuple[str, int, int], NDArray[np.float64]]:
        """Blocks of the design by stream, number and turn, as far as asked for: a cache of a pure function."""
        return {}

    @property
    def n_initial_waveforms(self) -> int:
        """Number of the user's own waveforms at the head of the campaign."""
        return len(self.config.waveform.initial)

    def generator(self, stream: str, index: int) -> np.random.Generator:
        """Random numbers keyed by (campaign.seed, stream, index): never drawn from a shared generator."""
        key = int.from_bytes(stream.encode()[:8].ljust(8, b"\0"), "big")
        return np.random.default_rng(np.random.SeedSequence([self.config.campaign.seed, key, index]))


@runtime_checkable
class Engine(Protocol):
    """Whoever proposes waveforms."""

    def propose(
        self, problem: Problem, index: int, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> Proposal:
        """The candidate `index`, from the committed candidates `history` and the waveforms in flight `pending`.

        Pure: the same arguments give the same bits. history is in order of index and ends at index - lag; pending holds
        the waveforms of the candidates between.
        """
        ...


def load_engine(name: str) -> Engine:
    """The engine of that name (an instance); imports only that engine. Raises EngineError naming the nearest one."""
    loaded = load_object("softclose.propose.finish:FinishEngine") if name == "finish" else ENGINES.load(name)
    return cast(Engine, loaded() if isinstance(loaded, type) else loaded)


def seen_by(index: int, history: Sequence[Observation], lag: int) -> Sequence[Observation]:
    """The records that candidate `index` may see: 0 … index - lag, however many more have come in."""
    return history[: max(index - lag + 1, 0)]


def search_history(problem: Problem, history: Sequence[Observation]) -> list[Observation]:
    """The records of the search itself, without those of the finishing stage."""
    return [o for o in history if o.index < problem.config.campaign.budget]
