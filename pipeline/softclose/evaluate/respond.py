"""Owns `respond`: what a lot does under a waveform, by the campaign's device, under all of its conditions."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from softclose.device.device import worst
from softclose.evaluate.asked import asked, asked_columns, worst_columns
from softclose.evaluate.chain import cases_of, chain_of, drives_of
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
        `asked` holds the quantities that the campaign asks for, (n, k).

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
    return counted(config, each)


def counted(config: CampaignConfig, each: list[Responses]) -> Responses:
    """What counts of responses in several cases: each switch's worst, and of each further quantity its own worst."""
    if len(each) == 1:
        return each[0]
    return replace(worst(each), asked=worst_columns(asked(config), [r.asked for r in each]))


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
    wanted = asked(config)
    if wanted:  # sums over impacts need as many as a campaign's store keeps
        outputs["max_impacts"] = max(outputs.get("max_impacts", 0), config.store.max_impacts)
    found = []
    for case in cases_of(chain, table):
        response = device.respond(case, drives, max_volts=max_volts, **outputs)
        if wanted:
            columns = asked_columns(wanted, chain, case, waveform, response, drives)
            response = replace(response, asked=columns)
        found.append(response)
    return found
