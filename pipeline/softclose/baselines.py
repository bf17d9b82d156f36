"""Owns the two reference designs that every campaign is compared with: the unshaped step and the deterministic design.

Both are the paper's (§4.1). The deterministic design is solved for the mean switch alone, whatever the population, in
the device model that the campaign has: a design for an ideal plate leaves a damped or flexible one open.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from softclose.arrays import FloatArray
from softclose.device.device import Device
from softclose.device.drives import Drives
from softclose.device.simulate import Responses
from softclose.device.told import mean_switch, sobol_switches
from softclose.plugins import SINGLE_MODE
from softclose.population import Population
from softclose.population.lot import Lot
from softclose.switch.losses import Losses
from softclose.switch.plate import holding_voltage, resonance
from softclose.waveform import MAX_VOLTS, MIN_RISE_US, Pulse, Waveform, is_above

SOFT_UM_PER_US = 1e-5
"""Largest contact speed of the mean switch that still counts as a soft landing [µm/µs]: 1e-3 cm/s."""

SOFT_ENOUGH_UM_PER_US = 5e-3
"""The same of a switch with losses or further modes: two pulses cannot silence a second mode [µm/µs]; 0.5 cm/s."""

_RTOL = 1e-12

COAST_US = 250.0
"""How long a single pulse is given to bring the mean switch to contact [µs]."""

_N_HELD = 4096
"""Switches of which all are to be held, where no formula says the worst."""


class BaselineError(ValueError):
    """A reference design that does not exist for this population and these limits."""


def unshaped(volts: float = 100.0) -> Waveform:
    """The unshaped drive: an ideal step to `volts` [V] at t = 0, held."""
    return Waveform([Pulse(0.0, 0.0, math.inf, volts)])


def _ideal(plate_area_um2: float) -> Device:
    """Eqs. 1-2."""
    return Device(
        name=SINGLE_MODE,
        horizon_us=COAST_US,
        restitution=0.5,
        plate_area_um2=plate_area_um2,
        rtol=_RTOL,
        method="taylor",
        losses=Losses(),
    )


def _run(device: Device, switch: FloatArray, waveform: Waveform) -> Responses:
    return device.respond(Lot.of(switch[None]), Drives(command=waveform))


def largest_holding_voltage(population: Population, device: Device) -> float:
    """Voltage [V] that holds every closed switch of the population, whatever its parameters within the bounds."""
    if device.modes is not None:
        return float(device.holding_voltage(sobol_switches(population, device, _N_HELD), sticks=False).max())
    gap = population.G.upper
    # K D (G - D)² grows with K and G, and with D up to G/3.
    travel = min(max(gap / 3.0, population.D.lower), population.D.upper)
    k = float(population.extremes()[0].max())
    return float(holding_voltage([travel, gap, k, 1.0], device.plate_area_um2))


def deterministic_design(
    population: Population,
    *,
    max_volts: float = MAX_VOLTS,
    rise_us: float = MIN_RISE_US,
    hold_volts: float | None = None,
    plate_area_um2: float | None = None,
    horizon_us: float = 250.0,
    device: Device | None = None,
) -> Waveform:
    """Two pulses that land the mean switch with no speed at all (paper §4.1).

    Pulse 1 has `max_volts` and `rise_us`; its width is solved for. Pulse 2 rises as fast, to `hold_volts`, and holds;
    by default to the voltage that holds every switch of the population, or to max_volts where that is less (ADR 042).
    At contact with no speed the net force must vanish and then press: so pulse 2 is started such that it passes
    the mean switch's holding voltage at the very instant of arrival. Width and start follow from the two
    conditions x = D and v = 0 at that instant. The solution is simulated, contact included, before it is returned.
    device: what simulates, with its own plate area; Eqs. 1-2 where it is left out.
    Raises BaselineError where there is no such waveform.
    """
    if device is None:
        device = _ideal(population.plate_area(plate_area_um2))
    device = replace(device, rtol=_RTOL, horizon_us=horizon_us)
    switch = mean_switch(population, device)
    all_held = min(largest_holding_voltage(population, device), max_volts)
    hold = all_held if hold_volts is None else float(hold_volts)
    needed = float(device.holding_voltage(switch, sticks=False)[0])
    if not needed < hold <= max_volts:
        raise BaselineError(
            f"pulse 2 would hold at {hold:.4g} V; it must exceed {needed:.4g} V, which holds the mean switch of "
            f"{population.name!r}, and not {max_volts:g} V (waveform.max_volts): choose another hold_volts or limit"
        )
    # From the start of pulse 2 until it passes the holding voltage, Eq. 13.
    lead_us = rise_us * math.acos(1.0 - 2.0 * needed / hold) / math.pi

    def design(peak_us: float, arrival_us: float) -> Waveform:
        return Waveform([Pulse(0.0, rise_us, peak_us, max_volts), Pulse(arrival_us - lead_us, rise_us, math.inf, hold)])

    free = switch.copy()
    free[0] = min(0.5 * (switch[0] + switch[1]), _known_to(device, switch))  # the same with the contact out of the way

    def miss(unknowns: FloatArray) -> FloatArray:
        peak_us, arrival_us = max(float(unknowns[0]), 0.0), max(float(unknowns[1]), lead_us + 1e-3)
        end = _run(replace(device, horizon_us=arrival_us), free, design(peak_us, arrival_us))
        return np.array([end.final_x[0] - switch[0], end.final_v[0]])

    from scipy.optimize import root

    # The first swing: further modes may carry a narrower pulse to the contact on a later one.
    first_swing = min(COAST_US, 1e3 / float(resonance(switch)) + 2.0 * rise_us)
    guess = _coast(switch, max_volts, rise_us, replace(device, horizon_us=first_swing), population.name)
    # Length over speed is about 1 / (10 µs): xtol in µs is what limits x, and 1e-12 of 20 µs is far below 1e-7 µm.
    solution = root(miss, guess, method="hybr", options={"xtol": 1e-13})
    waveform = design(max(float(solution.x[0]), 0.0), max(float(solution.x[1]), lead_us))
    landed = _run(device, switch, waveform)
    speed = float(landed.max_contact_speed[0])
    if not (speed <= (SOFT_UM_PER_US if device.scales else SOFT_ENOUGH_UM_PER_US) and landed.closed[0]):
        raise BaselineError(
            f"no two pulses of {max_volts:g} V and {hold:.4g} V rising in {rise_us:g} µs land the mean switch of "
            f"{population.name!r} softly (best found: contact at {speed * 100.0:.3g} cm/s, "
            f"{'closed' if landed.closed[0] else 'not closed'}): change the voltages"
        )
    peak = waveform.max_voltage(horizon_us)
    if is_above(peak, max_volts):
        raise BaselineError(
            f"the pulses overlap and reach {peak:.4g} V; the sum may not exceed {max_volts:g} V: lower hold_volts"
        )
    return waveform


def _known_to(device: Device, switch: FloatArray) -> float:
    """How far a contact may go before the electrode leaves what is known of its capacitance [µm]."""
    modes = device.modes
    if modes is None or modes.capacitance is None or not modes.capacitance.travel_um:
        return math.inf
    unit = modes.mode[0].electrode / modes.mode[0].contact
    return (1.0 - 1e-9) * modes.capacitance.travel_um[-1] / modes.capacitance.gap_um * float(switch[1]) / unit


def _coast(switch: FloatArray, volts: float, rise_us: float, device: Device, name: str) -> tuple[float, float]:
    """Width of the pulse that, alone, makes the switch just touch, and the instant at which it does [µs]."""

    def first_contact(peak_us: float) -> float:
        alone = Waveform([Pulse(0.0, rise_us, peak_us, volts)])
        return float(_run(device, switch, alone).first_contact_us[0])

    if math.isfinite(first_contact(0.0)):
        raise BaselineError(
            f"a pulse of {volts:g} V without any flat top already drives the mean switch of {name!r} into contact: "
            "lower max_volts or rise_us"
        )
    narrow, wide = 0.0, COAST_US
    arrival = first_contact(wide)
    if not math.isfinite(arrival):
        raise BaselineError(f"{volts:g} V never bring the mean switch of {name!r} to contact: raise max_volts")
    while wide - narrow > 1e-6:
        middle = 0.5 * (narrow + wide)
        contact = first_contact(middle)
        if math.isfinite(contact):
            wide, arrival = middle, contact
        else:
            narrow = middle
    return wide, arrival
