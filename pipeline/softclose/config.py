"""Owns a campaign's configuration: one TOML file in, every value checked before any work starts, a fingerprint out."""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, field_validator, model_validator
from pydantic.dataclasses import dataclass

from softclose.allowed import refusal
from softclose.losses import Losses
from softclose.naming import nearest
from softclose.plugins import ENGINES, MEASURED, MODELS, REDUCED_ORDER, SINGLE_MODE, EngineError, ModelError
from softclose.population import Population, load_population
from softclose.population.trim import Measured, Scaled, Trim
from softclose.presets import PresetError, find_preset
from softclose.reduced_order import ReducedOrder, read_reduced_order
from softclose.waveform import LEAST_RISE_US, MIN_RISE_US, Waveform

SETTINGS = ConfigDict(extra="forbid", strict=False, allow_inf_nan=False)

MOST_IN_A_WAVE = 4096
"""Candidates of a wave at most: what a kill may lose, and what a driver holds in memory."""

MAX_COUNT = 1_000_000
"""Candidates, descents, points … at most: a proposal looks at all of them, and a million take it minutes."""

MAX_SWITCHES = 100_000_000
"""Switches of one ensemble at most: a thousandth of them know v_u to 0.01 cm/s; one candidate takes minutes."""

MAX_HORIZON_US = 1e6
"""Simulated time at most [µs]: a second, a hundred thousand periods of the plate."""

MAX_CM_S = 1e6
"""Speeds and penalties at most [cm/s]: beyond it, 10 km/s, sums of squares lose what they are about."""

Count = Annotated[int, Field(ge=1, le=MAX_COUNT, strict=True)]
SwitchCount = Annotated[int, Field(ge=1, le=MAX_SWITCHES, strict=True)]
Positive = Annotated[float, Field(gt=0)]
Volts = Annotated[float, Field(ge=1, le=1000)]
NotNegative = Annotated[float, Field(ge=0)]
Probability = Annotated[float, Field(gt=0, lt=1)]


FrontObjective = Literal["v_u", "p_nc", "closing", "peak"]
"""What a front may weigh: upper velocity, switches not closed, closing time of the lot, largest voltage."""


class ConfigError(ValueError):
    """A configuration that cannot be used; the message lists every problem found."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class CampaignSection:
    """What is run, and how long."""

    name: str = "campaign"
    """A title for tables and reports."""
    seed: Annotated[int, Field(ge=0, lt=2**63, strict=True)] = 1
    """Key of every random number: the ensemble and the proposals."""
    budget: Annotated[int, Field(ge=0, le=MAX_COUNT, strict=True)] = 150
    """Candidates of the search, `waveform.initial` included; 0 leaves it out."""
    extensions: tuple[int | tuple[int, ...], ...] = ()
    """What was added after the campaign was finished, in turn: a number of candidates (`softclose resume --budget`
    writes it), or earlier candidates to compute again (`--retry-failed`)."""
    wave: Annotated[int, Field(ge=1, le=MOST_IN_A_WAVE, strict=True)] = 1
    """Candidates proposed together by an engine that proposes one at a time."""
    lag: Annotated[int, Field(ge=1, le=64, strict=True)] = 1
    """Waves of the search in flight at once: wave w waits for wave w - lag and sees nothing newer."""

    @field_validator("extensions", mode="before")
    @classmethod
    def _each_extension(cls, value: Any) -> Any:
        for place, what in enumerate(value if isinstance(value, list | tuple) else ()):
            again = isinstance(what, list | tuple)
            low, high = (0, MAX_COUNT - 1) if again else (1, MAX_COUNT)
            if not what or not all(type(v) is int and low <= v <= high for v in (what if again else (what,))):
                raise ValueError(
                    f"campaign.extensions.{place} is {what!r}; it must be a number from 1 to {MAX_COUNT}, or a "
                    "list of earlier candidates to compute again"
                )
        return value


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class PopulationSection:
    """Which switches."""

    name: Annotated[str, Field(min_length=1)] = "current"
    """A shipped population, or the path of a population TOML."""
    n_switches: SwitchCount = 2000
    """Switches in the training ensemble of each candidate."""
    sampling: Literal["monte-carlo", "sobol"] = "monte-carlo"
    """monte-carlo keeps Eq. 11 valid; sobol ranks candidates with less noise, and has no intervals."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class TrimSection:
    """One waveform, adjusted to each switch by what was measured on it."""

    measured: Measured = "nothing"
    """What is measured on each switch: the voltage at which it closes when that is raised slowly, its resonance; or
    only whether and when it touches in a few actuations."""
    scaled: Scaled = "voltage and time"
    """What the measurements change of its drive, each as far as they tell: volts as pull-in voltages, times as
    periods."""
    pull_in_error: Annotated[float, Field(ge=0, le=0.3)] = 0.01
    """Relative standard deviation of a measured pull-in voltage."""
    resonance_error: Annotated[float, Field(ge=0, le=0.3)] = 0.01
    """Relative standard deviation of a measured resonance."""
    actuations: Annotated[int, Field(ge=2, le=64, strict=True)] = 10
    """Contact times: closings and attempts of each switch in all, from which its scales are learned."""
    contact_time_error_us: Annotated[float, Field(ge=0, le=10)] = 0.1
    """Contact times: standard deviation of one timed contact [µs]."""
    bins: Annotated[int, Field(ge=0, le=4096, strict=True)] = 0
    """Bins of each measured quantity, whose switches share a drive; 0: each switch has its own."""
    keep_limits: bool = True
    """Whether every scaled drive keeps waveform.max_volts and waveform.min_rise_us; its scale ends there."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class AmplifierSection:
    """What stands between the commanded waveform and the switch; by default nothing does."""

    gain: Annotated[float, Field(gt=0, le=2)] = 1.0
    """Volts delivered over volts commanded, at rest: a known error of the gain."""
    offset_volts: Annotated[float, Field(ge=-50, le=50)] = 0.0
    """Added to what is delivered [V]."""
    delay_us: Annotated[float, Field(ge=0, le=1000)] = 0.0
    """Everything arrives so much later [µs]."""
    slew_volts_per_us: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Steepest slope of the output [V/µs]; 0: none is too steep."""
    bandwidth_kHz: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Frequency at which a sine comes out at -3 dB [kHz]; 0: every frequency passes."""
    order: Literal[1, 2] = 1
    """Order of that low-pass."""
    damping: Annotated[float, Field(ge=0.05, le=5)] = 0.7071
    """Damping ratio of the second order; 0.707 is the flattest, less overshoots."""
    resolution_volts: Annotated[float, Field(ge=0, le=50)] = 0.0
    """Step of the generator's voltages [V]; 0: none."""
    resolution_us: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Time between two voltages of the generator, each of which is held [µs]; 0: none."""
    step_us: Annotated[float, Field(gt=0, le=1)] = 0.05
    """Step in which all this is computed [µs]."""
    gain_error: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    """Relative standard deviation of the gain from one switch's drive to the next."""
    time_error: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    """Relative standard deviation of the generator's clock from one switch's drive to the next."""

    @property
    def is_ideal(self) -> bool:
        """Whether what is commanded is what is delivered, random errors aside."""
        plain = AmplifierSection(
            step_us=self.step_us,
            order=self.order,
            damping=self.damping,
            gain_error=self.gain_error,
            time_error=self.time_error,
        )
        return self == plain

    @property
    def scatters(self) -> bool:
        """Whether drives differ at random from one switch to the next."""
        return self.gain_error > 0.0 or self.time_error > 0.0


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class TemperatureSection:
    """A range of temperature over which the waveform has to hold; without tables, none matters."""

    low_C: Annotated[float, Field(ge=-273.15, le=2000)] = 20.0
    """Lowest temperature of the range [°C]: every switch of an ensemble has one of its own."""
    high_C: Annotated[float, Field(ge=-273.15, le=2000)] = 20.0
    """Highest temperature [°C]."""
    celsius: tuple[Annotated[float, Field(ge=-273.15, le=2000)], ...] = ()
    """Temperatures of the tables [°C], rising; the population is that at which the factor is 1 and the shifts are 0."""
    stiffness: tuple[Annotated[float, Field(gt=0, le=100)], ...] = ()
    """Stiffness there over that of the population: E(T) and residual stress."""
    gap_um: tuple[Annotated[float, Field(ge=-1e3, le=1e3)], ...] = ()
    """What the gap G is wider there [µm]."""
    travel_um: tuple[Annotated[float, Field(ge=-1e3, le=1e3)], ...] = ()
    """What the travel D is longer there [µm]."""
    worst_of: Annotated[int, Field(ge=0, le=64, strict=True)] = 0
    """Each switch is simulated at so many temperatures, evenly from low_C to high_C, and counts at its worst: its
    largest V, closed only where it closes at all of them. 0: at one temperature of its own, uniform over the range."""

    @property
    def spreads(self) -> bool:
        """Whether each switch has a temperature of its own."""
        return bool(self.celsius) and not self.worst_of

    @property
    def tried(self) -> tuple[float, ...]:
        """Temperatures at which every switch is simulated [°C]; (): at its own alone."""
        n = self.worst_of
        return tuple(self.low_C + (self.high_C - self.low_C) * k / (n - 1) for k in range(n))


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class ModelSection:
    """The device model: Eqs. 1-2 unless another one is named."""

    name: Annotated[str, Field(min_length=1)] = "single-mode"
    """single-mode, reduced-order (with `modes`), or an installed entry point of group softclose.models."""
    horizon_us: Annotated[float, Field(gt=0, le=MAX_HORIZON_US)] = 250.0
    """End of the simulated time [µs]."""
    restitution: Annotated[float, Field(gt=0, le=1)] = 0.5
    """Coefficient of restitution η, in (0, 1]."""
    plate_area_um2: NotNegative = 0.0
    """Plate area a [µm²]; 0: the area that the population was fitted with, else 16,700."""
    modes: str = ""
    """reduced-order: the TOML file of its modes; `softclose run` writes it into the store."""
    quality_factor: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    """single-mode: Q of the plate's own damping; 0: none."""
    film_viscosity_uPa_s: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Viscosity of the film of gas that is squeezed out of the gap [µPa s]; 0: no film. Air has 18."""
    film_length_um: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Longer side of the film [µm]; 0: that of a square of the plate's area."""
    film_width_um: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Shorter side of the film [µm]; 0: that of a square of the plate's area."""
    adhesion_uN: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    """Force with which a closed contact sticks [µN]: a release has to overcome it."""

    def build_losses(self) -> Losses:
        """Damping, film and adhesion."""
        return Losses(
            quality_factor=self.quality_factor,
            film_viscosity_uPa_s=self.film_viscosity_uPa_s,
            film_length_um=self.film_length_um,
            film_width_um=self.film_width_um,
            adhesion_uN=self.adhesion_uN,
        )


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class WaveformSection:
    """Where waveforms are searched."""

    space: Literal[
        "two-pulse-paper", "two-pulse-full", "three-pulse-full", "two-pulse-release", "three-pulse-release"
    ] = "two-pulse-full"
    """Search space; `-full` holds with its last pulse, `-release` lets go."""
    max_volts: Volts = 150.0
    """Limit on the sum of all pulses at any instant [V], from 1 to 1000."""
    min_rise_us: Annotated[float, Field(ge=LEAST_RISE_US, le=MAX_HORIZON_US)] = MIN_RISE_US
    """Fastest rise that may be proposed [µs]: what the second mode of the device allows; 4 is for the paper's plate."""
    initial: tuple[tuple[tuple[float | None, ...], ...], ...] = ()
    """The user's own waveforms, evaluated first: each a list of [start, rise, peak, volts]; a peak of "hold" holds."""
    initial_from: str = ""
    """A store whose best candidates are evaluated first; `softclose run` writes them into `initial`."""
    initial_count: Annotated[int, Field(ge=1, le=MOST_IN_A_WAVE, strict=True)] = 10
    """Most candidates that are taken from there."""

    @property
    def least_rise_us(self) -> float:
        """Fastest rise of waveforms that are given [µs]: a slower search refuses none of today's."""
        return min(self.min_rise_us, MIN_RISE_US)

    @field_validator("initial", mode="before")
    @classmethod
    def _read_holds(cls, value: Any) -> Any:
        """TOML has no null: a peak of "hold" (or inf) becomes None."""
        if not isinstance(value, list | tuple):
            return value
        return [
            [
                [_peak(v) if j == 2 else v for j, v in enumerate(row)] if isinstance(row, list | tuple) else row
                for row in rows
            ]
            if isinstance(rows, list | tuple)
            else rows
            for rows in value
        ]

    def initial_waveforms(self) -> tuple[Waveform, ...]:
        """`initial` as waveforms; raises WaveformError where one is malformed."""
        return tuple(Waveform.from_rows(rows) for rows in self.initial)


def _peak(value: Any) -> Any:
    return None if value == "hold" or (isinstance(value, float) and math.isinf(value)) else value


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class ObjectiveSection:
    """Eqs. 8-11."""

    form: Literal["penalty", "chance"] = "penalty"
    """penalty: g = v_u + c1·p_nc (Eq. 10); chance: minimise v_u subject to p_nc <= p_max."""
    risk: Literal["quantile", "cvar"] = "quantile"
    """What g is made of: the upper velocity v_u, or the mean V above it (conditional value at risk)."""
    level: Probability = 0.9
    """Quantile of V that is v_u."""
    closed_by_us: Annotated[float, Field(ge=0, le=MAX_HORIZON_US)] = 0.0
    """A switch counts as closed if it is held in contact from this instant on [µs]; 0: from any instant."""
    c1_cm_s: Annotated[float, Field(ge=0, le=MAX_CM_S)] = 25.0
    """Penalty per unit probability of not closing [cm/s]."""
    p_max: Annotated[float, Field(ge=0, lt=1)] = 0.05
    """Largest admissible p_nc of the chance-constrained form."""
    assured: bool = False
    """chance: the upper end of the interval of p_nc has to keep p_max, not only its estimate: what a search finds then
    keeps it on other switches too."""
    chance_penalty_cm_s: Annotated[float, Field(gt=0, le=MAX_CM_S)] = 500.0
    """chance: penalty per unit by which p_nc passes p_max [cm/s]. It has to outweigh what v_u gains by letting switches
    stay open: some 25 cm/s per unit where 5 % do, 500 where one in a thousand does."""
    limits_cm_s: tuple[Annotated[float, Field(gt=0, le=MAX_CM_S)], ...] = (19.7,)
    """Contact speeds for which P(V > limit) is reported [cm/s]."""
    min_contact: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Below this fraction of switches in contact v_u is undefined."""
    undefined_v_u_cm_s: Annotated[float, Field(gt=0, le=MAX_CM_S)] = 60.0
    """What an undefined v_u counts as in g [cm/s]."""
    confidence: Probability = 0.95
    """Confidence of every interval."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class OpeningSection:
    """How the lot is let go again; without an instant, a campaign designs the closing only."""

    release_us: Annotated[float, Field(ge=0, le=MAX_HORIZON_US)] = 0.0
    """Begin of the fall of the holding pulse [µs], at model.horizon_us or later; 0: the opening is not designed."""
    brake: Annotated[int, Field(ge=0, le=MAX_COUNT, strict=True)] = 300
    """Waveforms tried for a braking pulse after the fall of the best candidate; 0: it falls as it is."""
    n_switches: Annotated[int, Field(ge=10, le=MAX_COUNT, strict=True)] = 500
    """Switches of the training ensemble that the brake is designed on, all of a smaller one."""
    watch_us: Annotated[float, Field(ge=1, le=1e4)] = 200.0
    """How long the lot is watched after the fall began [µs], at 800 instants."""

    @property
    def is_designed(self) -> bool:
        """Whether the campaign designs the opening."""
        return self.release_us > 0.0


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class ReferenceSection:
    """The designs that every result is compared with."""

    step_volts: Annotated[float, Field(ge=0, le=1000)] = 0.0
    """Voltage of the unshaped step [V]; 0: 100 V, or waveform.max_volts where that is less."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class OptimiserSection:
    """Who proposes."""

    engine: Annotated[str, Field(min_length=1)] = "skopt"
    """skopt, sobol, paper, direct, cmaes, botorch, nsga2 (a front of `objectives`), or an installed entry point of
    group softclose.engines."""
    objectives: tuple[FrontObjective, ...] = ("v_u", "p_nc")
    """nsga2: what it weighs against each other, two to four of v_u, p_nc, closing (time) and peak (volts)."""
    n_initial: Annotated[int, Field(ge=2, le=MOST_IN_A_WAVE, strict=True)] = 20
    """Space-filling candidates before the surrogate proposes, one wave; `waveform.initial` takes the first places."""
    batch: Annotated[int, Field(ge=1, le=MOST_IN_A_WAVE, strict=True)] = 4
    """Candidates that the surrogate proposes together, a wave."""
    n_restart: Annotated[int, Field(ge=2, le=MAX_COUNT, strict=True)] = 8
    """Space-filling candidates after the trust region has shrunk to nothing, before it starts again elsewhere."""
    fresh_every: Count = 1
    """Every so many restarts begin elsewhere; the others open the trust region again around the best candidate."""
    n_candidates: Annotated[int, Field(ge=16, le=100_000, strict=True)] = 2000
    """Points at which the acquisition is screened."""
    fit_iterations: Count = 20
    """L-BFGS iterations of the surrogate's likelihood, from a fixed start."""
    n_fit: Annotated[int, Field(ge=16, le=MAX_COUNT, strict=True)] = 100
    """Points nearest to the incumbent from which the hyperparameters are fitted; the surrogate uses all points."""
    length_initial: Positive = 0.4
    """Width of the trust region at the start, in units of the search cube."""
    length_min: Positive = 0.03
    """Width below which the trust region starts again."""
    length_max: Positive = 1.6
    """Largest width."""
    success_tolerance: Count = 3
    """Successful waves in a row that double the trust region."""
    failure_tolerance: Annotated[int, Field(ge=0, le=MAX_COUNT, strict=True)] = 0
    """Candidates of failed waves in a row that halve it; 0: as many as there are parameters."""
    improvement_cm_s: Annotated[float, Field(ge=0)] = 0.01
    """Least decrease of g that counts as a success [cm/s]."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class ExploreSection:
    """Exploring: CMA-ES descents from several points, on the search's ensemble, by successive halving."""

    budget: Annotated[int, Field(ge=0, le=MAX_COUNT, strict=True)] = 0
    """Candidates of the descents; 0 leaves them out."""
    n_descents: Annotated[int, Field(ge=1, le=64, strict=True)] = 4
    """Descents begun; the better half goes on after each round. The first begins at the best of the search."""
    generation: Annotated[int, Field(ge=4, le=256, strict=True)] = 20
    """Candidates of one descent in one wave, in polishing too."""
    n_scouts: Annotated[int, Field(ge=1, le=256, strict=True)] = 40
    """Space-filling candidates of each descent; it begins at the best of them."""
    sigma: Annotated[float, Field(gt=0, le=0.5)] = 0.12
    """Size of a descent's first steps, in units of the search cube."""
    rounds: Annotated[int, Field(ge=1, le=16, strict=True)] = 2
    """Rounds of equal budgets; after each the better half of the descents goes on."""
    turns: Annotated[int, Field(ge=1, le=64, strict=True)] = 2
    """Sets of descents that take turns: waves in flight at once."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class FinishSection:
    """The finishing stage: further candidates on larger ensembles."""

    budget: Annotated[int, Field(ge=0, le=MAX_COUNT, strict=True)] = 0
    """Candidates of the finishing stage; 0 leaves it out."""
    n_switches: SwitchCount = 2000
    """Switches per candidate of the finishing stage."""
    grows: bool = False
    """cmaes: the polish begins on population.n_switches switches and doubles them in equal parts of its budget, up to
    n_switches: fewer trajectories for the same end."""
    n_basins: Annotated[int, Field(ge=1, le=MOST_IN_A_WAVE, strict=True)] = 8
    """Distinct basins found so far that are evaluated again, best first, one wave."""
    n_polished: Annotated[int, Field(ge=1, le=64, strict=True)] = 2
    """Basins whose polish begins (cmaes); the better half goes on after each round of equal budgets."""
    distance: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Largest coordinate distance in the search cube below which two candidates are one basin."""
    method: Literal["surrogate", "cmaes", "nelder-mead"] = "cmaes"
    """How the best basins are polished: cmaes takes a few hundred candidates, surrogate suits costly ones."""
    sigma: Annotated[float, Field(gt=0, le=0.5)] = 0.02
    """Size of the first steps of the polish, at least, in units of the search cube."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class ComputeSection:
    """How the work is cut up. Block boundaries are part of the store's identity."""

    block_switches: Annotated[int, Field(ge=0, le=MAX_SWITCHES, strict=True)] = 0
    """Simulated switches per block (one Dask task), several candidates' where ensembles are small; 0 chooses: 5,120, or
    more where that would cut a candidate into more than 64 blocks."""
    rtol: Annotated[float, Field(ge=1e-13, le=1e-6)] = 1e-9
    """Relative tolerance of the integrator; above 1e-6 a step may pass over a contact."""
    method: Literal["taylor", "rk"] = "taylor"
    """Integrator."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class StoreSection:
    """What the store keeps of each switch."""

    n_times: Annotated[int, Field(ge=2, le=100_001, strict=True)] = 1001
    """Points of the uniform time grid of x and v, from 0 to the horizon."""
    max_impacts: Annotated[int, Field(ge=1, le=4096, strict=True)] = 64
    """Impact events kept per switch; n_impacts counts all of them."""
    durable: bool = False
    """Sync every commit to the disk, against loss of power."""


WRITTEN_OUT = ("population_model", "reduced_order_model")
"""What no user writes: files, as they were read."""

AREA_RANGE_UM2 = (1.0, 1e9)
"""Plates from a micrometre to three centimetres wide [µm²]."""

STEP_VOLTS = 100.0
"""The published study's unshaped step [V]."""

MAX_BLOCKS = 256
"""Blocks of one candidate at most: the number of files stays bounded, whatever the ensemble."""

AUTO_BLOCKS = 64
"""Blocks of one candidate at most where compute.block_switches is 0."""

AUTO_BLOCK_SWITCHES = 5120
"""Simulated switches per block where compute.block_switches is 0: 50 to 100 ms, which outweighs Dask's millisecond."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class CampaignConfig:
    """A whole campaign. Build it with `load_config`."""

    campaign: CampaignSection = Field(default_factory=CampaignSection)
    population: PopulationSection = Field(default_factory=PopulationSection)
    trim: TrimSection = Field(default_factory=TrimSection)
    amplifier: AmplifierSection = Field(default_factory=AmplifierSection)
    temperature: TemperatureSection = Field(default_factory=TemperatureSection)
    model: ModelSection = Field(default_factory=ModelSection)
    waveform: WaveformSection = Field(default_factory=WaveformSection)
    objective: ObjectiveSection = Field(default_factory=ObjectiveSection)
    opening: OpeningSection = Field(default_factory=OpeningSection)
    reference: ReferenceSection = Field(default_factory=ReferenceSection)
    optimiser: OptimiserSection = Field(default_factory=OptimiserSection)
    explore: ExploreSection = Field(default_factory=ExploreSection)
    finish: FinishSection = Field(default_factory=FinishSection)
    compute: ComputeSection = Field(default_factory=ComputeSection)
    store: StoreSection = Field(default_factory=StoreSection)
    population_model: dict[str, Any] = Field(default_factory=dict)
    """The population itself, written out in full, so that a store does not depend on a file elsewhere."""
    reduced_order_model: dict[str, Any] = Field(default_factory=dict)
    """The modes of `model.modes`, written out likewise."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.population_model:
            object.__setattr__(self, "population_model", load_population(self.population.name).to_dict())
        self._check_model()
        self._check_temperature()
        self._check_opening()
        # Written out: a store says which area it was computed with, whatever a later version would choose.
        area = self.build_population().plate_area(self.model.plate_area_um2 or None)
        if not AREA_RANGE_UM2[0] <= area <= AREA_RANGE_UM2[1]:
            raise ValueError(
                f"model.plate_area_um2 is {area:g}; it must be 0 (that of the population) or from "
                f"{AREA_RANGE_UM2[0]:g} to {AREA_RANGE_UM2[1]:g} µm²"
            )
        object.__setattr__(self, "model", replace(self.model, plate_area_um2=area))
        step = self.reference.step_volts or min(STEP_VOLTS, self.waveform.max_volts)
        object.__setattr__(self, "reference", replace(self.reference, step_volts=step))
        for number, rows in enumerate(self.waveform.initial):
            try:
                waveform = Waveform.from_rows(rows)
                waveform.check(self.waveform.max_volts, self.model.horizon_us, self.waveform.least_rise_us)
            except ValueError as e:
                raise ValueError(f"waveform.initial[{number}]: {e}") from e
        if len(self.waveform.initial) > self.campaign.budget:
            raise ValueError(
                f"waveform.initial lists {len(self.waveform.initial)} waveforms, more than campaign.budget "
                f"{self.campaign.budget}: raise the budget or shorten the list"
            )
        if self.waveform.min_rise_us >= self.model.horizon_us:
            raise ValueError(
                f"waveform.min_rise_us is {self.waveform.min_rise_us:g}; no pulse would be up before model.horizon_us "
                f"{self.model.horizon_us:g}: lower it, or raise the horizon"
            )
        if self.trim.measured != "nothing" and (self.amplifier.scatters or not self.amplifier.is_ideal):
            raise ValueError(
                f"trim.measured is {self.trim.measured!r} and [amplifier] is set: what it delivers of a scaled drive "
                "is no scaled drive; leave one of them out"
            )
        if not self.campaign.budget + self.explore.budget:
            raise ValueError(
                "campaign.budget and explore.budget are both 0: there is nothing to evaluate; raise one of them"
            )
        if self.finish.grows and self.finish.method != "cmaes":
            raise ValueError(
                f"finish.grows is true and finish.method {self.finish.method}, which compares all candidates: "
                "ensembles of different sizes do not compare; use cmaes, or leave grows out"
            )
        x = self.explore
        largest = math.ceil(x.n_descents / x.turns) * max(x.n_scouts, x.generation)
        if largest > MOST_IN_A_WAVE:
            raise ValueError(
                f"explore.n_descents {x.n_descents} in {x.turns} turns make a wave of {largest} candidates; at most "
                f"{MOST_IN_A_WAVE} are allowed: use fewer descents or scouts, or more turns"
            )
        objectives = self.optimiser.objectives
        if not 2 <= len(objectives) == len({*objectives}):
            raise ValueError(
                f"optimiser.objectives is {list(objectives)!r}; it must be two to four different ones of v_u, p_nc, "
                "closing and peak"
            )
        self._check_extensions()
        self._choose_blocks()
        n, block = self.n_switches_max, self.compute.block_switches
        if math.ceil(n / block) > MAX_BLOCKS:
            raise ValueError(
                f"compute.block_switches {block} cuts an ensemble of {n} switches into {math.ceil(n / block)} blocks; "
                f"at most {MAX_BLOCKS} are allowed, so that the number of files stays bounded: "
                f"use {math.ceil(n / MAX_BLOCKS)} or more, or 0"
            )
        return self

    def _check_model(self) -> None:
        m = self.model
        if m.name == REDUCED_ORDER:
            if not self.reduced_order_model:
                if not m.modes:
                    raise ValueError("model.name is reduced-order: give model.modes, the TOML file of its modes")
                modes = read_reduced_order(m.modes).to_dict()
                object.__setattr__(self, "reduced_order_model", modes)
            self.build_reduced_order()
        elif m.modes or self.reduced_order_model:
            raise ValueError(f"model.modes is {m.modes!r}, and model.name {m.name!r} has none: use reduced-order")
        losses = m.build_losses()
        if m.name not in (SINGLE_MODE, REDUCED_ORDER) and not losses.none:
            raise ValueError(
                f"model.name {m.name!r} has its own losses: leave quality_factor, film_* and adhesion_uN 0"
            )
        if m.name == REDUCED_ORDER and m.quality_factor:
            raise ValueError("model.quality_factor belongs to single-mode: give each [[mode]] its quality_factor")

    def _check_temperature(self) -> None:
        t = self.temperature
        tables = {"stiffness": t.stiffness, "gap_um": t.gap_um, "travel_um": t.travel_um}
        if not t.low_C <= t.high_C:
            raise ValueError(f"temperature.low_C is {t.low_C:g} and high_C {t.high_C:g}; it must not be reversed")
        if not t.celsius:
            if any(tables.values()) or t.low_C != t.high_C or t.worst_of:
                raise ValueError("temperature.celsius is missing: give the temperatures of the tables")
            return
        if t.worst_of and (t.worst_of == 1 or t.low_C == t.high_C):
            raise ValueError(
                f"temperature.worst_of is {t.worst_of} from {t.low_C:g} to {t.high_C:g} °C; it must be 0, or 2 and "
                "more over a range that is one"
            )
        if len(t.celsius) < 2 or list(t.celsius) != sorted(set(t.celsius)):
            raise ValueError("temperature.celsius must list two or more temperatures, rising")
        for name, values in tables.items():
            if values and len(values) != len(t.celsius):
                raise ValueError(
                    f"temperature.{name} has {len(values)} entries, temperature.celsius {len(t.celsius)}: give as many"
                )
        if not (t.celsius[0] <= t.low_C and t.high_C <= t.celsius[-1]):
            raise ValueError(
                f"the range of {t.low_C:g} to {t.high_C:g} °C leaves the tables, which end at {t.celsius[0]:g} and "
                f"{t.celsius[-1]:g} °C: extend them"
            )
        lot = self.build_population()
        for i, celsius in enumerate(t.celsius):
            longest = lot.D.upper + (t.travel_um[i] if t.travel_um else 0.0)
            shortest = lot.D.lower + (t.travel_um[i] if t.travel_um else 0.0)
            narrowest = lot.G.lower + (t.gap_um[i] if t.gap_um else 0.0)
            if not 0.0 < shortest <= longest < narrowest:
                raise ValueError(
                    f"at {celsius:g} °C travels are {shortest:g} to {longest:g} µm and gaps go down to {narrowest:g} "
                    "µm; every switch needs 0 < D < G: check temperature.travel_um and gap_um"
                )

    def _check_opening(self) -> None:
        release = self.opening.release_us
        if not release:
            return
        if release < self.model.horizon_us:
            raise ValueError(
                f"opening.release_us is {release:g}; the closing is judged until model.horizon_us "
                f"{self.model.horizon_us:g}: let go then or later"
            )
        others = {
            "[trim] scales the drive of each switch": self.trim.measured != "nothing",
            "amplifier.gain_error and time_error scale the drive of each switch": self.amplifier.scatters,
            "temperature.worst_of tells of each switch only the worst": self.temperature.worst_of > 0,
            f"waveform.space {self.waveform.space} lets go by itself": self.waveform.space.endswith("-release"),
            "the devices themselves are measured": self.model.name == MEASURED,
        }
        for why, clashes in others.items():
            if clashes:
                raise ValueError(f"opening.release_us is {release:g}, and {why}: leave one of them out")

    def build_reduced_order(self) -> ReducedOrder:
        """The modes, from their stored description."""
        return ReducedOrder.from_dict(self.reduced_order_model)

    def _check_extensions(self) -> None:
        if self.campaign.extensions and self.total_budget > MAX_COUNT:
            raise ValueError(
                f"the campaign has {self.total_budget} candidates with its extensions; at most {MAX_COUNT}"
            )
        n = self.first_budget
        for what in self.campaign.extensions:
            if isinstance(what, tuple) and max(what) >= n:
                raise ValueError(
                    f"campaign.extensions computes candidate {max(what)} again, and there are {n} before it"
                )
            n += extension_size(what)

    def check_plugins(self) -> None:
        """Raise EngineError or ModelError where this machine lacks the engine or the device model.

        Apart from reading a configuration: what a store holds can be read anywhere, only proposing and simulating
        need the plug-ins.
        """
        ENGINES.check(self.optimiser.engine)
        MODELS.check(self.model.name)

    def revised(self, overrides: Iterable[str]) -> CampaignConfig:
        """The same campaign with other values; what was written out stays.

        Parameters
        ----------
        overrides : iterable of str
            `section.key=value` each.

        Raises
        ------
        ConfigError
            Naming every problem.
        """
        data = self.to_dict()
        for override in _texts(overrides):
            _apply(data, override)
        return _validate(data)

    @property
    def first_budget(self) -> int:
        """Candidates of all stages but extensions."""
        return self.campaign.budget + self.explore.budget + self.finish.budget

    @property
    def total_budget(self) -> int:
        """Candidates of all stages."""
        return self.first_budget + sum(map(extension_size, self.campaign.extensions))

    def extended(self, total: int) -> CampaignConfig:
        """The same campaign with candidates added.

        Parameters
        ----------
        total : int
            Candidates in all.

        Raises
        ------
        ConfigError
            Where it has as many.
        """
        if isinstance(total, bool) or not isinstance(total, int):
            raise ConfigError(f"{total!r} is no number of candidates; give a whole one above {self.total_budget}")
        if total <= self.total_budget:
            raise ConfigError(f"the campaign has {self.total_budget} candidates; give a larger total than {total}")
        return self._with_extension(total - self.total_budget)

    def retried(self, candidates: Sequence[int]) -> CampaignConfig:
        """The same campaign with earlier candidates to be computed again at its end.

        Parameters
        ----------
        candidates : sequence of int
            Their indices.

        Raises
        ------
        ConfigError
            Where one is no candidate of the campaign.
        """
        return self._with_extension(list(candidates))

    def _with_extension(self, what: int | list[int]) -> CampaignConfig:
        data = self.to_dict()
        data["campaign"]["extensions"].append(what)
        return _validate(data)

    @property
    def n_switches_max(self) -> int:
        """Rows of the stored ensemble: the largest that any candidate uses."""
        return max(self.population.n_switches, self.finish.n_switches if self.finish.budget else 0)

    @property
    def block_switches(self) -> int:
        """Simulated switches per block."""
        return self.compute.block_switches

    def _choose_blocks(self) -> None:
        """Write the automatic choice out: a later version may choose otherwise, and a store must not notice."""
        if not self.compute.block_switches:
            chosen = max(AUTO_BLOCK_SWITCHES, math.ceil(self.n_switches_max / AUTO_BLOCKS))
            object.__setattr__(self, "compute", replace(self.compute, block_switches=chosen))

    def build_population(self) -> Population:
        """The population, from its stored description."""
        return Population.from_dict(self.population_model)

    def build_trim(self) -> Trim | None:
        """How the drives of the population's switches are scaled; None where one waveform drives them all."""
        t = self.trim
        if t.measured == "nothing":
            return None
        return Trim(
            population=self.build_population(),
            plate_area_um2=self.model.plate_area_um2,
            measured=t.measured,
            pull_in_error=t.pull_in_error,
            resonance_error=t.resonance_error,
            bins=t.bins,
            scaled=t.scaled,
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON-able values, the inverse of `from_dict`."""
        dumped: dict[str, Any] = TypeAdapter(CampaignConfig).dump_python(self, mode="json")
        return dumped

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> CampaignConfig:
        """Validate plain values; raises ConfigError."""
        return _validate(data)

    def fingerprint(self) -> str:
        """sha256 of the canonical JSON of everything that decides the content of the store."""
        return hashlib.sha256(canonical_json(self.to_dict()).encode()).hexdigest()


def extension_size(extension: int | tuple[int, ...]) -> int:
    """Candidates of an extension."""
    return extension if isinstance(extension, int) else len(extension)


def canonical_json(data: Mapping[str, Any]) -> str:
    """One text per value: sorted keys, no spaces, shortest floats."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def known_keys() -> dict[str, tuple[str, ...]]:
    """Section name -> its keys, for messages and the reference documentation."""
    sections = {f.name: f.type for f in fields(CampaignConfig) if f.name not in WRITTEN_OUT}
    by_name = {cls.__name__: cls for cls in _SECTIONS}
    return {name: tuple(f.name for f in fields(by_name[str(kind)])) for name, kind in sections.items()}


_SECTIONS = (
    CampaignSection,
    PopulationSection,
    TrimSection,
    AmplifierSection,
    TemperatureSection,
    ModelSection,
    WaveformSection,
    ObjectiveSection,
    OpeningSection,
    ReferenceSection,
    OptimiserSection,
    ExploreSection,
    FinishSection,
    ComputeSection,
    StoreSection,
)


def load_config(source: str | Path | Mapping[str, Any], overrides: Iterable[str] = ()) -> CampaignConfig:
    """Read a preset by name, a TOML file or a mapping, apply overrides, validate.

    Parameters
    ----------
    source : str, Path or mapping
        Relative paths of populations and modes in a TOML are taken from its own folder, those of overrides from here.
    overrides : iterable of str
        `section.key=value` each.

    Returns
    -------
    CampaignConfig

    Raises
    ------
    ConfigError
        Naming every problem: what was got, what is allowed.
    """
    if isinstance(source, Mapping):
        data, where = _copy(source), None
    else:
        try:
            where = find_preset(source)
        except PresetError as e:
            raise ConfigError(str(e)) from e
        data = read_toml(where)
    for section, key in (("population", "name"), ("model", "modes")):
        table = data.get(section)
        if not isinstance(table, dict):
            continue
        name = table.get(key)
        if where is not None and isinstance(name, str) and name.endswith(".toml") and not Path(name).is_absolute():
            beside = where.parent / name
            if beside.exists():
                table[key] = str(beside)
    for override in _texts(overrides):  # paths in them are from where the user stands, not from a file's own folder
        _apply(data, override)
    config = _validate(data)
    try:
        config.check_plugins()
    except (EngineError, ModelError) as e:
        raise ConfigError(str(e)) from e
    return config


def read_toml(path: Path) -> dict[str, Any]:
    """Parse one TOML file; raises ConfigError with the path and the position."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as e:
        raise ConfigError(f"no configuration file at {path}") from e
    except (OSError, UnicodeDecodeError) as e:
        raise ConfigError(f"cannot read {path}: {e}") from e
    except tomllib.TOMLDecodeError as e:
        raise ConfigError(f"{path} is not valid TOML: {e}") from e


def _copy(source: Mapping[str, Any]) -> dict[str, Any]:
    return {k: _copy(v) if isinstance(v, Mapping) else v for k, v in source.items()}


def _texts(overrides: Iterable[str]) -> list[str]:
    found = [overrides] if isinstance(overrides, str) or not isinstance(overrides, Iterable) else list(overrides)
    for text in found:
        if not isinstance(text, str):
            raise ConfigError(f"{text!r} is no setting; give texts of the form section.key=value, e.g. campaign.seed=7")
    return found


def _apply(data: dict[str, Any], override: str) -> None:
    """Set one `section.key=value`; the value is TOML, and a bare word is a string."""
    key, sign, text = override.partition("=")
    section, dot, name = key.strip().partition(".")
    if not (sign and dot and section and name):
        raise ConfigError(f"--set {override!r} is not of the form section.key=value, e.g. campaign.seed=7")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    table = data.setdefault(section, {})
    if not isinstance(table, dict):
        raise ConfigError(f"{section} is {table!r}; it must be a table of keys")
    table[name] = value


def _validate(data: Mapping[str, Any]) -> CampaignConfig:
    if not isinstance(data, Mapping):
        raise ConfigError(f"{data!r} is no configuration; give a mapping of sections")
    _refuse_unknown(data)
    try:
        return TypeAdapter(CampaignConfig).validate_python(dict(data))
    except ValidationError as e:
        problems = [_problem(x["loc"], x["type"], x["input"], x["msg"]) for x in e.errors(include_url=False)]
        raise ConfigError("\n".join(problems)) from e


def _problem(place: tuple[int | str, ...], kind: str, got: Any, said: str) -> str:
    """One problem in this project's words; a check of our own says everything already."""
    if kind == "value_error":
        return said.removeprefix("Value error, ")
    kinds = {f.name: f.type for f in fields(CampaignConfig)}
    section = next((cls for cls in _SECTIONS if cls.__name__ == kinds[str(place[0])]), None)
    if section is None or len(place) < 2:
        return f"{'.'.join(map(str, place))} is {got!r}; it must be a table of keys"
    return refusal(section, str(place[1]), got, place)


def _refuse_unknown(data: Mapping[str, Any]) -> None:
    known = known_keys()
    problems = []
    for section, table in data.items():
        if section in WRITTEN_OUT:
            continue
        if section not in known:
            problems.append(_unknown("section", section, known))
        elif not isinstance(table, Mapping):
            problems.append(f"{section} is {table!r}; it must be a table of keys: {', '.join(known[section])}")
        else:
            problems += [
                _unknown("key", f"{section}.{key}", [f"{s}.{k}" for s, ks in known.items() for k in ks])
                for key in table
                if key not in known[section]
            ]
    if problems:
        raise ConfigError("\n".join(problems))


def _unknown(kind: str, name: str, allowed: Iterable[str]) -> str:
    allowed = list(allowed)
    close = nearest(name, allowed)
    hint = f"did you mean {close}?" if close else f"known: {', '.join(allowed)}"
    return f"unknown {kind} {name}; {hint}"
