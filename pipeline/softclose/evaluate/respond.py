"""Owns `respond`: what a lot does under a waveform, by the campaign's device, under all of its conditions."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from softclose.conditions.protocol import Case
from softclose.device.device import worst
from softclose.device.drives import Drives
from softclose.evaluate.chain import Chain, chain_of
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.switch.plate import plate_area_of
from softclose.waveform import Drive

if TYPE_CHECKING:
    from softclose.device.simulate import Responses


def respond(
    config: CampaignConfig,
    lot: Lot | ArrayLike,
    waveform: Drive,
    *,
    max_volts: float = math.inf,
    for_everybody: bool = False,
    horizon_us: float | None = None,
    **outputs: Any,
) -> Responses:
    """Responses of a lot to one waveform, by the campaign's device and under its conditions.

    Parameters
    ----------
    config : CampaignConfig
        Device model and conditions.
    lot : Lot
        As `draw` makes it, with the columns of every condition; (n, 4) D, G, K, M where no condition needs more.
    waveform : Waveform or Trace
        A waveform goes through the campaign's amplifier; a trace is what one has delivered already.
    max_volts : float
        A waveform above it is a WaveformError [V]; reference designs and faulty drives are simulated whatever the
        campaign's limit.
    for_everybody : bool
        No drive is tailored to its switch, as under reference designs. Errors of the drives stay.
    horizon_us : float, optional
        Another end of the simulation than the campaign's [µs].
    outputs : dict
        `times_us`, `max_impacts`, `dtype` and `threads` of the device model. Where times of drives are scaled, sampled
        x and v are those at the time scale times `times_us`.

    Returns
    -------
    Responses
        (n,) each; where the campaign tries several cases (`temperature.worst_of`), each switch's is that at its worst.

    Raises
    ------
    LotError
        Where the lot lacks a column that a condition needs.
    OtherAreaError
        Where it is of another plate area than the campaign's.
    WaveformError
        For a waveform above max_volts.
    """
    each = respond_each(
        config, lot, waveform, max_volts=max_volts, for_everybody=for_everybody, horizon_us=horizon_us, **outputs
    )
    return each[0] if len(each) == 1 else worst(each)


def respond_each(
    config: CampaignConfig,
    lot: Lot | ArrayLike,
    waveform: Drive,
    *,
    max_volts: float = math.inf,
    for_everybody: bool = False,
    horizon_us: float | None = None,
    **outputs: Any,
) -> list[Responses]:
    """Responses of a lot to one waveform in each case, one or more; parameters and errors are those of `respond`."""
    chain = chain_of(config)
    device = chain.device if horizon_us is None else replace(chain.device, horizon_us=horizon_us)
    table = Lot.of(lot)
    plate_area_of(table, device.plate_area_um2)  # raises for switches of another one
    drives = drives_of(chain, table, waveform, for_everybody=for_everybody)
    return [device.respond(case, drives, max_volts=max_volts, **outputs) for case in cases_of(chain, table)]


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
