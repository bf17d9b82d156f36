"""Owns a campaign's configuration: its sections together, checked before any work starts, a fingerprint out."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Self

from pydantic import Field, TypeAdapter, ValidationError, model_validator
from pydantic.dataclasses import dataclass

from softclose.allowed.refusal import refusal, shown
from softclose.allowed.tables import MOST_PROBLEMS, listed
from softclose.allowed.types import (
    MAX_COUNT,
    MAX_HORIZON_US,
    MOST_IN_A_WAVE,
    SETTINGS,
)
from softclose.conditions.amplifier import AmplifierSection
from softclose.conditions.model_error import ModelErrorSection
from softclose.conditions.temperature import TemperatureSection
from softclose.conditions.trim import TrimSection
from softclose.device.cost import PLAIN_S, fewest_rows, seconds_a_trajectory
from softclose.device.options import options_of
from softclose.metrics.control import LEAST
from softclose.naming import nearest
from softclose.plugins import ENGINES, MEASURED, MODELS, REDUCED_ORDER, SINGLE_MODE, ModelError, load_object
from softclose.population import Population, load_population
from softclose.settings.campaign import CampaignSection, PopulationSection, extension_size
from softclose.settings.errors import ConfigError
from softclose.settings.model import ModelSection
from softclose.settings.objective import ObjectiveSection, ReferenceSection
from softclose.settings.opening import OpeningSection
from softclose.settings.overrides import apply, texts
from softclose.settings.prior import PriorSection
from softclose.settings.scaled import PUBLISHED, STEP, scaled
from softclose.settings.search import ExploreSection, FinishSection, OptimiserSection
from softclose.settings.storage import (
    AUTO_BLOCK_SWITCHES,
    AUTO_BLOCKS,
    MAX_BLOCKS,
    STORED_S,
    ComputeSection,
    StoreSection,
)
from softclose.settings.waveform import WaveformSection
from softclose.switch.reduced_order import ReducedOrder, read_reduced_order
from softclose.waveform import Waveform

WRITTEN_OUT = ("population_model", "reduced_order_model")
"""What no user writes: files, as they were read."""

MANY_TIMES = 8
"""Cheap switches of a control variate for each costly one, at least: fewer know the lot hardly better."""

LED_BY_PRIOR = "skopt"
"""The engine that starts from a prior."""

AREA_RANGE_UM2 = (1.0, 1e9)
"""Plates from a micrometre to three centimetres wide [µm²]."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class CampaignConfig:
    """A whole campaign. Build it with `load_config`."""

    campaign: CampaignSection = Field(default_factory=CampaignSection)
    population: PopulationSection = Field(default_factory=PopulationSection)
    trim: TrimSection = Field(default_factory=TrimSection)
    amplifier: AmplifierSection = Field(default_factory=AmplifierSection)
    temperature: TemperatureSection = Field(default_factory=TemperatureSection)
    model: ModelSection = Field(default_factory=ModelSection)
    model_error: ModelErrorSection = Field(default_factory=ModelErrorSection)
    waveform: WaveformSection = Field(default_factory=WaveformSection)
    objective: ObjectiveSection = Field(default_factory=ObjectiveSection)
    opening: OpeningSection = Field(default_factory=OpeningSection)
    reference: ReferenceSection = Field(default_factory=ReferenceSection)
    optimiser: OptimiserSection = Field(default_factory=OptimiserSection)
    prior: PriorSection = Field(default_factory=PriorSection)
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
            # The content is what counts: the same campaign begun from another folder is the same campaign.
            object.__setattr__(self, "population", replace(self.population, name=file_name(self.population.name)))
        self._check_model()
        self.temperature.check_lot(self.build_population())
        self._check_opening()
        # Written out: a store says which area it was computed with, whatever a later version would choose.
        area = self.build_population().plate_area(self.model.plate_area_um2 or None)
        if not AREA_RANGE_UM2[0] <= area <= AREA_RANGE_UM2[1]:
            raise ValueError(
                f"model.plate_area_um2 is {area:g}; it must be 0 (that of the population) or from "
                f"{AREA_RANGE_UM2[0]:g} to {AREA_RANGE_UM2[1]:g} µm²"
            )
        object.__setattr__(self, "model", replace(self.model, plate_area_um2=area))
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
        self._check_prior()
        objectives = self.optimiser.objectives
        if not 2 <= len(objectives) == len({*objectives}) <= 4:
            raise ValueError(
                f"optimiser.objectives is {list(objectives)!r}; it must be two to four different quantities, such as "
                "v_u, p_nc, closing and peak"
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
        self._scale_with_the_lot()
        return self

    def _check_model(self) -> None:
        m = self.model
        if m.name == REDUCED_ORDER:
            if not self.reduced_order_model:
                if not m.modes:
                    raise ValueError("model.name is reduced-order: give model.modes, the TOML file of its modes")
                modes = read_reduced_order(m.modes).to_dict()
                object.__setattr__(self, "reduced_order_model", modes)
                object.__setattr__(self, "model", replace(m, modes=file_name(m.modes)))
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

    @property
    def has_prior(self) -> bool:
        """Whether a search by the Gaussian process starts from a prior."""
        return self.prior.is_there and self.optimiser.engine == LED_BY_PRIOR and self.campaign.budget > 0

    def _check_prior(self) -> None:
        if self.prior.control:
            self._check_control()
        if not self.has_prior:
            return
        if self.prior.model == MEASURED:
            raise ValueError("prior.model is measured: devices are no cheap model; use single-mode, or none")
        if self.prior.model == REDUCED_ORDER and not self.reduced_order_model:
            raise ValueError(
                "prior.model is reduced-order, and the campaign's own model has no modes (model.modes): use single-mode"
            )
        left = self.campaign.budget - len(self.waveform.initial)
        if self.optimiser.n_regions > left:
            raise ValueError(
                f"optimiser.n_regions is {self.optimiser.n_regions}, and campaign.budget leaves {left} candidates for "
                "them: raise campaign.budget, use fewer regions, or set prior.model to none"
            )

    def _check_control(self) -> None:
        n = self.population.n_switches
        clashes = {
            "no search of this campaign starts from a prior (prior.model, optimiser.engine, campaign.budget)": (
                not self.has_prior
            ),
            "devices are measured, whose parameters nobody knows": self.model.name == MEASURED,
            "one Sobol sample has no interval by which to see whether it pays: use replicated or monte-carlo": (
                self.population.sampling == "sobol"
            ),
            "it says nothing of the tail that objective.risk cvar weighs: use quantile": self.objective.risk == "cvar",
            f"population.n_switches is {n}, of which a regression says too little: use {LEAST} or more": n < LEAST,
            f"it has to be many times population.n_switches {n}: use {MANY_TIMES * n} or more": (
                self.prior.control < MANY_TIMES * n
            ),
        }
        for why, there in clashes.items():
            if there:
                raise ValueError(f"prior.control is {self.prior.control}, and {why}; or leave it 0")

    def _check_opening(self) -> None:
        release = self.opening.release_us
        if not release:
            return
        if release < self.model.horizon_us:
            raise ValueError(
                f"opening.release_us is {release:g}; the closing is judged until model.horizon_us "
                f"{self.model.horizon_us:g}: let go then or later"
            )
        if release + self.opening.watch_us > MAX_HORIZON_US:
            raise ValueError(
                f"opening.release_us is {release:g} and opening.watch_us {self.opening.watch_us:g}; together they may "
                f"reach {MAX_HORIZON_US:g} µs"
            )
        others = {
            f"waveform.space {self.waveform.space} lets go by itself": self.waveform.space.endswith("-release"),
            "the devices themselves are measured": self.model.name == MEASURED,
        }
        for why, clashes in others.items():
            if clashes:
                raise ValueError(f"opening.release_us is {release:g}, and {why}: leave one of them out")

    def _scale_with_the_lot(self) -> None:
        """Write out what the objective and the reference step are by default: in proportion to the lot's own."""
        o, m = self.objective, self.model
        missing = [name for name in PUBLISHED if o.is_left_out(name)]
        if missing or not self.reference.step_volts:
            step, speeds, why = scaled(
                self.population_model,
                self.reduced_order_model,
                m.build_losses(),
                max_volts=self.waveform.max_volts,
                horizon_us=m.horizon_us,
                restitution=m.restitution,
                plate_area_um2=m.plate_area_um2,
                rtol=self.compute.rtol,
                method=self.compute.method,
            )
            if missing and not speeds:
                because = f" ({why})" if why else ""
                raise ValueError(
                    f"a step of {step:g} V ({STEP:g} times the pull-in voltage of the mean switch, at most "
                    f"waveform.max_volts) closes too few switches to scale prices with the lot{because}: "
                    f"give {', '.join(f'objective.{name}' for name in missing)}, or "
                    + ("lower waveform.max_volts" if why else "raise waveform.max_volts or model.horizon_us")
                )
            object.__setattr__(self, "objective", replace(o, **{name: speeds[name] for name in missing}))
            step = self.reference.step_volts or step
            object.__setattr__(self, "reference", replace(self.reference, step_volts=step))
        if o.form == "chance" and o.p_max > o.max_open:
            raise ValueError(
                f"objective.p_max is {o.p_max:g} and objective.max_open {o.max_open:g}: candidates that leave more "
                "than max_open open rank behind all others; raise max_open to p_max at least"
            )

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
        """Raise EngineError, ModelError or QuantityError where this machine lacks the engine, the device model or a
        quantity.

        Apart from reading a configuration: what a store holds can be read anywhere, only proposing and simulating
        need the plug-ins.
        """
        ENGINES.check(self.optimiser.engine)
        self.check_models()
        load_object("softclose.evaluate.asked:asked")(self)  # by name: the evaluation is above the settings

    def check_models(self) -> None:
        """Raise ModelError where this machine lacks the device model, or that of the prior."""
        MODELS.check(self.model.name)
        if self.has_prior:
            try:
                MODELS.check(self.prior.model)
            except ModelError as e:
                raise ModelError(f"prior.model: {e}") from e

    def with_options(self) -> CampaignConfig:
        """The same campaign with every option of its device model written out, so that they are part of its identity.

        Raises ModelError where the model does not allow them.
        """
        options = options_of(self.model.name, self.model.options)
        if options is None:
            return self
        return replace(self, model=replace(self.model, options=options.model_dump(mode="json")))

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
        for override in texts(overrides):
            apply(data, override)
        return validated(data)

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
        return validated(data)

    @property
    def n_switches_max(self) -> int:
        """Rows of the stored ensemble: the largest that any candidate uses."""
        return max(self.population.n_switches, self.finish.n_switches if self.finish.budget else 0)

    @property
    def block_switches(self) -> int:
        """Simulated switches per block."""
        return self.compute.block_switches

    @property
    def seconds_a_switch(self) -> float:
        """What simulating a switch under one waveform takes, about [s], by the device model's word: all its cases."""
        each = seconds_a_trajectory(
            self.model.name, lossless=self.model.build_losses().none, ideal=self.amplifier.is_ideal
        )
        return each * self.n_cases

    @property
    def n_cases(self) -> int:
        """Cases in which every switch is simulated under a waveform."""
        return max(len(self.temperature.tried), 1) * self.model_error.n_cases

    @property
    def n_kept_cases(self) -> int:
        """How often a switch is stored under a waveform: in each of several cases, and as what counts of them."""
        return 1 if self.n_cases == 1 else 1 + self.n_cases

    @property
    def n_modes(self) -> int:
        """Modes of each switch whose motion is simulated; 1 where the device model tells of none."""
        return len(self.reduced_order_model["mode"]) if self.model.name == REDUCED_ORDER else 1

    def _choose_blocks(self) -> None:
        """Write the automatic choice out: a later version may choose otherwise, and a store must not notice."""
        if not self.compute.block_switches:
            slower = (self.seconds_a_switch + STORED_S) / (PLAIN_S + STORED_S)
            by_cost = max(math.floor(AUTO_BLOCK_SWITCHES / slower), fewest_rows(self.seconds_a_switch))
            chosen = max(by_cost, math.ceil(self.n_switches_max / AUTO_BLOCKS))
            object.__setattr__(self, "compute", replace(self.compute, block_switches=chosen))

    def build_population(self) -> Population:
        """The population, from its stored description."""
        return Population.from_dict(self.population_model)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON-able values, the inverse of `from_dict`."""
        dumped: dict[str, Any] = TypeAdapter(CampaignConfig).dump_python(self, mode="json")
        return dumped

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> CampaignConfig:
        """Validate plain values; raises ConfigError."""
        return validated(data)

    def fingerprint(self) -> str:
        """sha256 of the canonical JSON of everything that decides the content of the store."""
        return hashlib.sha256(canonical_json(self.to_dict()).encode()).hexdigest()


def file_name(path: str) -> str:
    """What a configuration keeps of the path of a file whose content it keeps: its name. Names stay as they are."""
    return Path(path).name if path.endswith(".toml") else path


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
    ModelErrorSection,
    WaveformSection,
    ObjectiveSection,
    OpeningSection,
    ReferenceSection,
    OptimiserSection,
    PriorSection,
    ExploreSection,
    FinishSection,
    ComputeSection,
    StoreSection,
)


def validated(data: Mapping[str, Any]) -> CampaignConfig:
    if not isinstance(data, Mapping):
        raise ConfigError(f"{data!r} is no configuration; give a mapping of sections")
    try:
        return TypeAdapter(CampaignConfig).validate_python(dict(data))
    except ValidationError as e:
        errors = e.errors(include_url=False)
        problems = [_problem(x["loc"], x["type"], x["input"], x["msg"]) for x in errors[:MOST_PROBLEMS]]
        raise ConfigError(listed(problems, len(errors))) from e


def _problem(place: tuple[int | str, ...], kind: str, got: Any, said: str) -> str:
    """One problem in this project's words; a check of our own says everything already."""
    if kind == "value_error":
        return said.removeprefix("Value error, ")
    known, name = known_keys(), ".".join(map(str, place))
    section = str(place[0])
    if section not in known and section not in WRITTEN_OUT:
        return _unknown("section", section, known)
    cls = next((cls for cls in _SECTIONS if cls.__name__ == str(CampaignConfig.__annotations__[section])), None)
    if cls is None:
        return f"{name} is {shown(got)}; it must be a table of keys"
    if len(place) < 2:
        return f"{name} is {shown(got)}; it must be a table of keys: {', '.join(known[section])}"
    if place[1] not in known[section]:
        return _unknown("key", f"{section}.{place[1]}", [f"{s}.{k}" for s, ks in known.items() for k in ks])
    return refusal(cls, str(place[1]), got, name, place[2:])


def _unknown(kind: str, name: str, allowed: Iterable[str]) -> str:
    allowed = list(allowed)
    close = nearest(name[:80], allowed)
    hint = f"did you mean {close}?" if close else f"known: {', '.join(allowed)}"
    return f"unknown {kind} {name[:80]}; {hint}"
