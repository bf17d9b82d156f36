"""Owns what an objective costs by default: in proportion to the speeds of the lot, as the published study's to its own.

There 25 cm/s a switch that stays open and the limit of 19.7 cm/s belong to a lot that a step of 1.24 times its pull-in
voltage closes at 41.6 cm/s. On a lot that the same step closes at 200 cm/s an open switch would be almost free.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from softclose.device.device import Device
from softclose.device.drives import Drives
from softclose.device.status import reasons
from softclose.device.told import mean_switch, sobol_switches
from softclose.metrics.objective import assess
from softclose.plugins import REDUCED_ORDER, SINGLE_MODE
from softclose.population import Population
from softclose.population.lot import Lot
from softclose.switch.losses import Losses
from softclose.switch.reduced_order import ReducedOrder
from softclose.waveform import Pulse, Waveform

PUBLISHED_V_U_CM_S = 41.6
"""v_u of the published study's lot under its step of 100 V [cm/s]."""
PUBLISHED = {"c1_cm_s": 25.0, "undefined_v_u_cm_s": 60.0, "chance_penalty_cm_s": 500.0, "limits_cm_s": 19.7}
"""Its speeds, by their keys in `[objective]`."""
LIMITS = "limits_cm_s"
"""The one of them that is a list."""
STEP = 1.24
"""Its step over the pull-in voltage of the mean switch: 100 V over 80.8 V."""
N_SWITCHES = 4096
"""Switches of a lot whose v_u is taken: Sobol points, the same every time."""
DIGITS = 3
"""That a figure is rounded to: processors differ in the last bit, and a campaign must not."""


def scaled(
    population: Mapping[str, Any], modes: Mapping[str, Any], losses: Losses, *, max_volts: float, **device: Any
) -> tuple[float, dict[str, Any], str]:
    """The step and the speeds of `[objective]` that go with a lot.

    Parameters
    ----------
    population, modes : mapping
        Written out, as a configuration keeps them; modes is empty but for a reduced-order model.
    losses : Losses
        Of the device model.
    max_volts : float
        Largest voltage that a drive may have [V].
    **device
        `horizon_us`, `restitution`, `plate_area_um2`, `rtol` and `method` of `Device`. A device model of somebody
        else's may be costly, and gets Eqs. 1-2.

    Returns
    -------
    float
        The step [V]: `STEP` times the mean switch's pull-in voltage, at most max_volts.
    dict
        The keys of `PUBLISHED`, in proportion to v_u under that step; {} where it closes too few to have one.
    str
        Why switches could not be integrated under that step; "" where all could.
    """
    lot, shapes = (json.dumps(d, sort_keys=True) for d in (population, modes))
    return _scaled(lot, shapes, losses, max_volts, tuple(sorted(device.items())))


@lru_cache(maxsize=64)
def _scaled(
    lot: str, shapes: str, losses: Losses, max_volts: float, told: tuple[tuple[str, Any], ...]
) -> tuple[float, dict[str, Any], str]:
    population, modes = Population.from_dict(json.loads(lot)), json.loads(shapes)
    device = Device(
        name=REDUCED_ORDER if modes else SINGLE_MODE,
        losses=losses,
        modes=ReducedOrder.from_dict(modes) if modes else None,
        **dict(told),
    )
    pull_in = float(device.closing_voltage(mean_switch(population, device))[0])
    step = min(rounded(STEP * pull_in), max_volts) if math.isfinite(pull_in) else max_volts
    drive = Drives(command=Waveform([Pulse(0.0, 0.0, math.inf, step)]))
    closed = device.respond(Lot.of(sobol_switches(population, device, N_SWITCHES)), drive)
    v_u = assess(closed, sampling="sobol").v_u_cm_s
    if not v_u > 0.0:
        return step, {}, reasons(closed.status)
    part = v_u / PUBLISHED_V_U_CM_S
    found: dict[str, Any] = {name: rounded(part * value) for name, value in PUBLISHED.items()}
    return step, found | {LIMITS: (found[LIMITS],)}, reasons(closed.status)


def rounded(value: float) -> float:
    """To `DIGITS` significant digits."""
    return float(f"{value:.{DIGITS}g}")
