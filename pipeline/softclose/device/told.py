"""Owns switches that a lot tells by their pull-in voltage: in a device model that voltage is the model's own.

Eq. 3 is of an ideal plate. Where electrode and contact move differently, or the capacitance is a table, a switch of the
stiffness that Eq. 3 gives pulls in elsewhere than it was told to. The voltage grows with the root of the stiffness.
"""

from __future__ import annotations

import numpy as np

from softclose.arrays import FloatArray
from softclose.device.device import Device
from softclose.plugins import REDUCED_ORDER
from softclose.population import Population, PopulationError
from softclose.switch.losses import Losses
from softclose.switch.reduced_order import ReducedOrder

_N_MEAN = 4096
"""Switches whose mean stands for the mean switch where no formula does."""


def switches_of(population: Population, device: Device, parameters: FloatArray) -> FloatArray:
    """Switches of given parameters, in a device model.

    Parameters
    ----------
    population : Population
        What the parameters are.
    device : Device
        What the switches are simulated by.
    parameters : (n, 4) ndarray of float64
        Columns as `population.variables`.

    Returns
    -------
    (n, 4) ndarray of float64
        Columns D, G [µm], K [N/m], M [µg].

    Raises
    ------
    PopulationError
        Where no stiffness makes a switch of this model close at the voltage that it was told to.
    """
    switches = population.switches(parameters)
    if "U_pi" not in population.variables or device.modes is None:
        return switches
    told = parameters[:, population.variables.index("U_pi")]
    found = device.closing_voltage(switches)
    if not (np.isfinite(found) & (found > 0.0)).all():
        raise PopulationError(
            f"population {population.name!r} tells pull-in voltages, and the electrode of the model {device.name} does "
            "not pull its contact: check the participations of its modes"
        )
    stiffer = (told / found) ** 2  # at the same resonance the mass grows as the stiffness does
    switches[:, 2:] *= stiffer[:, None]
    return switches


def sobol_switches(population: Population, device: Device, n: int) -> FloatArray:
    """Switches that stand for a lot in a device model, the same every time: n Sobol points, a power of 2.

    Returns
    -------
    (n, 4) ndarray of float64
        Columns D, G [µm], K [N/m], M [µg].

    Raises
    ------
    PopulationError
        As `switches_of`.
    """
    return switches_of(population, device, population.sample_parameters(n, seed=0, sampling="sobol"))


def closing_summary(population: Population, modes: ReducedOrder, plate_area_um2: float) -> dict[str, float]:
    """Pull-in voltages of a lot in a reduced-order model [V], named as in `Population.summary`; of 4,096 switches."""
    device = Device(
        name=REDUCED_ORDER,
        horizon_us=1.0,
        restitution=1.0,
        plate_area_um2=plate_area_um2,
        rtol=1e-9,
        method="taylor",
        losses=Losses(),
        modes=modes,
    )
    volts = device.closing_voltage(sobol_switches(population, device, _N_MEAN))
    return {
        "U_pi_lower_V": float(volts.min()),
        "U_pi_upper_V": float(volts.max()),
        "U_pi_mean_switch_V": float(device.closing_voltage(mean_switch(population, device))[0]),
    }


def mean_switch(population: Population, device: Device) -> FloatArray:
    """The deterministic switch of a lot in a device model: (4,) E[D], E[G] [µm], E[K] [N/m], E[M] [µg]."""
    mean = np.asarray(population.mean_switch, dtype=np.float64)
    if "U_pi" in population.variables and device.modes is not None:
        mean[2:] = sobol_switches(population, device, _N_MEAN)[:, 2:].mean(axis=0)
    return mean
