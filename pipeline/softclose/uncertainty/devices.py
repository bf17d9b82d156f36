"""Owns how sure a waveform's figures are where the lot is known from a few measured devices only.

The waveform is judged on every lot that the devices may have come from (`softclose.population.plausible`). What the
figures vary by is the uncertainty that comes from having measured few devices. All lots are judged on the same
uniforms, so that the luck of an ensemble is not in it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from softclose.arrays import FloatArray
from softclose.conditions.streams import Ensemble
from softclose.evaluate import evaluate, realise, uniforms
from softclose.evaluate.pieces import Mapper, Sent, here
from softclose.metrics.intervals import NO_INTERVAL, Interval
from softclose.metrics.objective import Assessment
from softclose.population.calibrate import plausible_populations
from softclose.population.population import Population
from softclose.settings import CampaignConfig
from softclose.switch.plate import pull_in_voltage, resonance
from softclose.waveform import Waveform

FEWEST_LOTS = 20
FAR_OFF = 4.0
"""Standard errors by which the mean of devices of the same lot is off once in 16,000 times."""
_N_LOT = 4096
"""Switches that stand for a lot."""


class DevicesError(ValueError):
    """A question about devices that has no answer."""


@dataclass(frozen=True, slots=True)
class _Lot:
    """A lot that a waveform is judged on."""

    sent: Sent
    waveform: Waveform
    population: Population
    n_switches: int
    seed: int


def _judged(lot: _Lot) -> Assessment:
    """Conditions go on believing in the lot as fitted: what is scaled by it was scaled before the truth is known."""
    config = lot.sent.config
    u = uniforms(config, lot.n_switches, seed=lot.seed, ensemble=Ensemble.DEVICES)
    return evaluate(config, realise(config, u, population=lot.population), lot.waveform, fresh=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Propagated:
    """A waveform's figures, with the uncertainty from having measured few devices."""

    n_devices: int
    """Devices that the lot was fitted to."""
    assessment: Assessment
    """On the lot as fitted."""
    v_u_cm_s: FloatArray
    """(n_lots,) v_u on each lot that as many devices may have come from [cm/s]."""
    p_nc: FloatArray
    """(n_lots,) fraction not closed on each."""
    g_cm_s: FloatArray
    """(n_lots,) objective on each [cm/s]."""
    n_failed: int
    """Lots that are no population (D must stay below G); they are left out."""
    confidence: float
    """Of the intervals."""

    def interval(self, name: str) -> Interval:
        """Percentile interval of `v_u_cm_s`, `p_nc` or `g_cm_s`; NaN where no lot has one."""
        tail, values = 50.0 * (1.0 - self.confidence), getattr(self, name)
        if np.isnan(values).all():
            return NO_INTERVAL
        low, high = np.nanpercentile(values, [tail, 100.0 - tail])
        return float(low), float(high)


def apart(own: Population, fitted: Population, n_devices: int, plate_area_um2: float) -> tuple[list[str], list[str]]:
    """How a lot that devices tell of differs from the one that a campaign was made for.

    By travel, gap, pull-in voltage (Eq. 3) and resonance of the mean switch.

    Parameters
    ----------
    own, fitted : Population
        The campaign's lot, and the one fitted to the devices.
    n_devices : int
        Devices that it was fitted to.
    plate_area_um2 : float
        Plate area of both [µm²].

    Returns
    -------
    list of str
        What lies outside all of the campaign's lot, in words: these devices are of another one.
    list of str
        What lies inside, and is further off than `FAR_OFF` standard errors of so many devices.
    """

    def columns(s: FloatArray) -> FloatArray:
        return np.stack([s[:, 0], s[:, 1], pull_in_voltage(s, plate_area_um2), resonance(s)])

    lot = columns(np.asarray(own.sample(_N_LOT, seed=0, sampling="sobol")))
    mean = columns(np.asarray(fitted.sample(_N_LOT, seed=0, sampling="sobol"))).mean(axis=1)
    other, shifted = [], []
    for name, unit, values, value in zip(("D", "G", "U_pi", "f"), ("µm", "µm", "V", "kHz"), lot, mean, strict=True):
        low, high = float(values.min()), float(values.max())
        said = f"{name} is {value:.4g} {unit} on average, and that of the campaign's lot {values.mean():.4g} ({low:.4g}"
        said += f"–{high:.4g})"
        if not low <= value <= high:
            other.append(said)
        elif abs(value - values.mean()) > FAR_OFF * values.std() / math.sqrt(n_devices):
            shifted.append(said)
    return other, shifted


def propagate(
    config: CampaignConfig,
    waveform: Waveform,
    population: Population,
    n_devices: int,
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    n_lots: int = 200,
    n_switches: int = 4_000,
    seed: int = 0,
    mapper: Mapper = here,
    listener: Callable[[int, int], None] | None = None,
) -> Propagated:
    """Judge a waveform on lots that the measured devices may have come from.

    Parameters
    ----------
    config : CampaignConfig
        Objective, device model, drive and conditions; its own population is not used.
    waveform : Waveform
        What drives the lot.
    population : Population
        The lot as fitted to the devices.
    n_devices : int
        How many they were.
    bounds : mapping, optional
        (lower, upper) of any of D, G, E, T that were known, not fitted.
    n_lots : int
        Lots.
    n_switches : int
        Switches that each is judged on.
    seed : int
        Of devices and switches.
    mapper : Mapper
        Who simulates.
    listener : callable, optional
        Told (done, all).

    Returns
    -------
    Propagated

    Raises
    ------
    DevicesError
        For too few lots, or where most draws of devices are no population.
    """
    if n_lots < FEWEST_LOTS:
        raise DevicesError(f"{n_lots} lots make no interval; {FEWEST_LOTS} at least (200 are usual)")
    area = replace(config.model, plate_area_um2=population.plate_area())
    settings = replace(config, model=area, population_model=population.to_dict())
    sent = Sent(settings)
    figures = np.full((3, n_lots), math.nan)
    failed = 0
    lots = list(plausible_populations(population, n_devices, n_lots, seed=seed, bounds=bounds))
    wanted = [population, *(lot for lot in lots if lot is not None)]
    answers = mapper(_judged, [_Lot(sent, waveform, lot, n_switches, seed) for lot in wanted])
    fitted = next(answers)
    for k, lot in enumerate(lots):
        if lot is None:
            failed += 1
        else:
            a = next(answers)
            figures[:, k] = a.v_u_cm_s, a.p_nc, a.g_cm_s
        if listener is not None:
            listener(k + 1, n_lots)
    if failed > 0.5 * n_lots:
        raise DevicesError(
            f"{failed} of {n_lots} draws of {n_devices} devices are no population (D must stay below G): give the "
            "bounds that the process keeps (--bounds)"
        )
    return Propagated(
        n_devices=n_devices,
        assessment=fitted,
        v_u_cm_s=figures[0],
        p_nc=figures[1],
        g_cm_s=figures[2],
        n_failed=failed,
        confidence=config.objective.confidence,
    )
