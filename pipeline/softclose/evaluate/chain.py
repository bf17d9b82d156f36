"""Owns the chain of a campaign: device and conditions, from the configuration; what drives a lot, in which cases."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache, reduce
from typing import Any

from softclose.conditions.amplifier import Amplifier
from softclose.conditions.learning import TailoredByLearning
from softclose.conditions.model_error import UncertainModel
from softclose.conditions.protocol import Case, Condition, Surroundings
from softclose.conditions.temperature import Temperature
from softclose.conditions.trim import Tailored
from softclose.device.device import Device
from softclose.device.drives import Drives
from softclose.device.options import options_where_installed
from softclose.plugins import REDUCED_ORDER
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Drive

CONDITIONS: tuple[type[Condition], ...] = (UncertainModel, Tailored, TailoredByLearning, Amplifier, Temperature)
"""Every condition, in the order of the signal's way: what is measured is measured before what changes a switch."""


@dataclass(frozen=True, slots=True)
class Chain:
    """What a lot is drawn and simulated with."""

    around: Surroundings
    """The lot as it is believed to be, the device, the drive's limits."""
    conditions: tuple[Condition, ...]
    """Those that the campaign has."""

    @property
    def device(self) -> Device:
        """What simulates."""
        return self.around.device


def chain_of(config: CampaignConfig) -> Chain:
    """The chain of a configuration; the same object for the same configuration."""
    return _chain(_Same(config))


def device_of(config: CampaignConfig) -> Device:
    """The device model of a campaign, with its settings."""
    model, compute = config.model, config.compute
    return Device(
        name=model.name,
        horizon_us=model.horizon_us,
        restitution=model.restitution,
        plate_area_um2=model.plate_area_um2,
        rtol=compute.rtol,
        method=compute.method,
        losses=model.build_losses(),
        options=options_where_installed(model.name, model.options),
        modes=config.build_reduced_order() if model.name == REDUCED_ORDER else None,
    )


def seconds_a_switch(config: CampaignConfig) -> float:
    """`CampaignConfig.seconds_a_switch`, worked out once: analyses ask before every question, be it of ten switches."""
    return _seconds(_Same(config))


class _Same:
    """A configuration, equal to itself alone: it is never changed, and comparing all of it would cost a simulation."""

    __slots__ = ("config",)

    def __init__(self, config: CampaignConfig) -> None:
        self.config = config

    def __hash__(self) -> int:
        return id(self.config)

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, _Same) and other.config is self.config


@lru_cache(maxsize=16)
def _seconds(same: _Same) -> float:
    return same.config.seconds_a_switch


@lru_cache(maxsize=16)
def _chain(same: _Same) -> Chain:
    config = same.config
    around = Surroundings(
        population=config.build_population(),
        device=device_of(config),
        max_volts=config.waveform.max_volts,
        min_rise_us=config.waveform.min_rise_us,
        delivery=Amplifier(config.amplifier),
    )
    built = (kind.of(getattr(config, kind.section), around) for kind in CONDITIONS)
    return Chain(around=around, conditions=tuple(condition for condition in built if condition is not None))


def drives_of(chain: Chain, lot: Lot, waveform: Drive, *, for_everybody: bool = False) -> Drives:
    """What drives each switch of a lot under one waveform."""
    drives = Drives(command=waveform)
    for condition in chain.conditions:
        if not (for_everybody and condition.tailored):
            drives = condition.drives(drives, lot)
    return drives


def cases_of(chain: Chain, lot: Lot) -> list[Lot]:
    """The lot in every combination of its conditions' cases."""
    return [reduce(lambda changed, case: case.of(changed), chosen, lot) for chosen in combinations(chain)]


def combinations(chain: Chain) -> list[tuple[Case, ...]]:
    """Every combination of the conditions' cases, in the order in which they are simulated; [()] without any."""
    return [*itertools.product(*(found for condition in chain.conditions if (found := condition.cases())))]
