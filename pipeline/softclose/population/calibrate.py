"""Owns calibration (paper §2.2): device measurements in, modulus of each device and a fitted population out.

E follows from Eqs. 3-4. D and G get Betas, E and T uniform distributions, as in the published study. Where resonances
were measured, K or the pull-in voltage and f are fitted instead, by Betas.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from softclose.arrays import FloatArray
from softclose.population import copula
from softclose.population.copula import Correlation
from softclose.population.distributions import Bounded, PopulationError
from softclose.population.files import write_population
from softclose.population.fit import Fit, fit, may_be
from softclose.population.marginals import Marginal
from softclose.population.measurements import MeasurementError, Measurements
from softclose.population.plausible import FitKind
from softclose.population.population import UNITS, VARIABLES, Population
from softclose.switch.plate import PLATE_AREA_UM2, modulus, stiffness_from_pull_in

FALL_SHORT = {
    30: ("lower end, upper end and sd", "with 12, 90 to 92 % in place of 95"),
    100: ("sd", "with 60, 92 % in place of 95"),
}
"""Of fewer devices than these, which intervals of a distribution whose bounds are fitted too were measured to fall
short where it is steep at one end, and to what (docs/measurements/coverage.md has 12 and 60)."""

KINDS: dict[str, FitKind] = {
    "D": "beta",
    "G": "beta",
    "E": "uniform",
    "T": "uniform",
    "K": "beta",
    "f": "beta",
    "U_pi": "beta",
}
"""What each variable is fitted by."""
_PLAUSIBLE_E_GPA = (1.0, 1000.0)
_FITTED_T_UM = (5.0, 9.0)


MOST = 0.99
"""Rank correlation that is believed at most, of devices that are finitely many."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """A population fitted to measurements, and how well."""

    population: Population
    """The fitted population."""
    parameters: FloatArray
    """(n, 4) the population's variables of each device: D, G [µm], E [GPa], T [µm] of a plate."""
    fits: dict[str, Fit]
    """One for each variable."""
    correlation: FloatArray
    """(4, 4) rank correlation of the variables. Pairs in which it is significant are correlated in the population too;
    E from Eqs. 3-4 inherits the errors of G and T, which can correlate it with them (paper §2.2)."""
    confidence: float
    """Confidence of every interval."""
    notes: tuple[str, ...]
    """What a reader should know before using the population."""

    def panels(self, n_grid: int = 200) -> dict[str, dict[str, FloatArray]]:
        """Fig. 3: for each variable the histogram (edges, density) and the fitted curve (grid, fitted)."""
        out: dict[str, dict[str, FloatArray]] = {}
        for column, v in zip(self.parameters.T, self.population.variables, strict=True):
            b = self.fits[v].distribution
            density, edges = np.histogram(column, bins=max(5, math.ceil(math.sqrt(column.size))), density=True)
            margin = 0.05 * (b.upper - b.lower)
            grid = np.linspace(b.lower - margin, b.upper + margin, n_grid)
            out[v] = {"edges": edges, "density": density, "grid": grid, "fitted": b.density(grid)}
        return out

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON: the population, every fitted number with its interval, goodness of fit, notes."""
        return {
            "n_devices": len(self.parameters),
            "confidence": self.confidence,
            "population": self.population.to_dict(),
            "fits": {
                v: {
                    "kind": KINDS[v],
                    "unit": UNITS[v],
                    "cramer_von_mises": f.statistic,
                    "p_value": f.p_value,
                    **{name: [e.value, *e.interval] for name, e in f.numbers.items()},
                }
                for v, f in self.fits.items()
            },
            "rank_correlation": self.correlation.tolist(),
            "notes": list(self.notes),
        }


def device_parameters(measurements: Measurements, plate_area_um2: float = PLATE_AREA_UM2) -> FloatArray:
    """(n, 4) D, G and the variables of `measurements.law`: of a plate E [GPa] and T [µm], E what makes the stiffness of
    Eq. 4 the one that Eq. 3 asks for."""
    m = measurements
    if m.T_um is None or m.pull_in_V is None:
        of = {"U_pi": m.pull_in_V, "f": m.resonance_kHz, "K": m.K_N_per_m}
        return np.stack([m.D_um, m.G_um, *(np.asarray(of[v]) for v in m.law)], axis=1)
    e = modulus(stiffness_from_pull_in(m.pull_in_V, m.G_um, plate_area_um2), m.T_um)
    low, high = _PLAUSIBLE_E_GPA
    for device, value in zip(m.device, e, strict=True):
        if not low <= value <= high:
            raise MeasurementError(
                f"device {device}: its pull-in voltage gives a modulus of {value:.3g} GPa; expected {low:g}–{high:g} "
                f"GPa. Check pull_in_V, G_um, T_um and the plate area ({plate_area_um2:g} µm²)"
            )
    return np.stack([m.D_um, m.G_um, e, m.T_um], axis=1)


def calibrate(
    measurements: Measurements,
    *,
    name: str = "calibrated",
    bounds: Mapping[str, tuple[float, float]] | None = None,
    plate_area_um2: float = PLATE_AREA_UM2,
    n_bootstrap: int = 500,
    confidence: float = 0.95,
    seed: int = 0,
) -> Calibration:
    """Fit the population from Eqs. 3-6 and the published ranges to measurements.

    Parameters
    ----------
    measurements : Measurements
        Of n devices.
    name : str
        Of the population.
    bounds : mapping, optional
        (lower, upper) of any of D, G, T [µm] and E [GPa] that is known from the process; the others are estimated, see
        `softclose.population.fit`.
    plate_area_um2 : float
        Area of the electrode [µm²].
    n_bootstrap : int
        Lots that the devices may have come from, of which the intervals are the middle.
    confidence : float
        Of the intervals.
    seed : int
        Same seed, same intervals.

    Returns
    -------
    Calibration

    Raises
    ------
    MeasurementError
        For settings that are none, or a variable that is the same for all devices.
    """
    if not 0.0 < plate_area_um2 < math.inf:
        raise MeasurementError(f"the plate area is {plate_area_um2:g} µm²; it must be above 0 (--plate-area)")
    bounds = dict(bounds or {})
    variables = ("D", "G", *measurements.law)
    parameters = device_parameters(measurements, plate_area_um2)
    _check_settings(bounds, variables, parameters, n_bootstrap, confidence)
    notes: list[str] = [*measurements.notes]
    fits: dict[str, Fit] = {}
    for stream, (v, column) in enumerate(zip(variables, parameters.T, strict=True)):
        if np.ptp(column) <= 1e-9 * column.mean():
            raise MeasurementError(f"{v} is the same for all devices; a distribution needs values that differ")
        fits[v] = fit(
            column,
            KINDS[v],
            bounds=bounds.get(v),
            n_bootstrap=n_bootstrap,
            confidence=confidence,
            seed=seed,
            stream=stream,
        )
        if fits[v].p_value < 0.05:
            notes.append(
                f"{v} is poorly described by a {KINDS[v]} distribution (Cramér-von Mises p = {fits[v].p_value:.3f})"
            )
    told = [v for v in variables if KINDS[v] == "beta" and v not in bounds]
    short = [said for fewer_than, said in FALL_SHORT.items() if len(parameters) < fewer_than]
    if told and short:
        which, held = short[0]
        notes.append(
            f"of {len(parameters)} devices the intervals of {which} of {', '.join(told)} may hold less often than they "
            f"say: {held} where the distribution is steep at one end"
        )
    thickness = parameters[:, 3] if variables[3] == "T" else np.full(len(parameters), _FITTED_T_UM[0])
    outside = int(((thickness < _FITTED_T_UM[0]) | (thickness > _FITTED_T_UM[1])).sum())
    if outside:
        notes.append(f"{outside} devices are thinner or thicker than the 5–9 µm for which Eq. 4 was fitted")
    correlation, pairs, together = correlations(parameters, variables)
    if not together:
        notes.append("the correlations of the devices do not go together in one population, which takes none of them")
    notes += [
        f"{a} and {b} are correlated (rank correlation {rho:.2f}), and so in the population" for a, b, rho in pairs
    ]
    try:
        population = Population(
            name=name,
            description=f"Fitted to {len(parameters)} measured devices",
            plate_area_um2=float(plate_area_um2),
            correlation=pairs,
            formula=None,
            **{v: f.distribution for v, f in fits.items()},
        )
    except PopulationError as e:
        raise MeasurementError(f"the fitted distributions are no population: {e}. Give the process's bounds") from e
    return Calibration(
        population=population,
        parameters=parameters,
        fits=fits,
        correlation=correlation,
        confidence=confidence,
        notes=tuple(notes),
    )


def correlations(
    parameters: FloatArray, variables: tuple[str, ...] = VARIABLES
) -> tuple[FloatArray, tuple[Correlation, ...], bool]:
    """Rank correlations of devices: all (4, 4), those that a population takes, and whether these go together.

    A population takes the significant ones (5 % for all six pairs), or none where they do not go together.
    """
    found, p_values = rank_correlation(parameters)
    pairs = tuple(
        (variables[j], variables[i], round(float(np.clip(found[i, j], -MOST, MOST)), 4))
        for i in range(4)
        for j in range(i)
        if p_values[i, j] < 0.05 / 6.0  # six pairs
    )
    try:
        copula.check(pairs, variables)
    except PopulationError:
        return found, (), False
    return found, pairs, True


def rank_correlation(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Spearman's rank correlations of the columns of (n, k), and how often as large ones come by chance; (k, k) each.

    Those of `scipy.stats.spearmanr`, which takes three times as long: `propagate` asks for hundreds. NaN of a column
    that is the same throughout.
    """
    from scipy.special import stdtr
    from scipy.stats import rankdata

    n = len(values)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.corrcoef(rankdata(values, axis=0), rowvar=False)
        t = found * np.sqrt(((n - 2) / ((found + 1.0) * (1.0 - found))).clip(0.0))
    return found, np.asarray(2.0 * stdtr(n - 2, -np.abs(t)))


def plausible_populations(
    population: Population,
    n: int,
    n_lots: int,
    *,
    seed: int,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> Iterator[Population | None]:
    """n_lots populations that n devices may have come from which a population was fitted to, measured without error.

    None in the place of one that is none (D must stay below G). bounds: of variables that were known, not fitted.
    Correlations are those of as many devices drawn from the population.
    """
    known = dict(bounds or {})
    fitted = dict(zip(population.variables, population.marginals(), strict=True))
    lots = {
        v: may_be(_fitted(fitted[v], v), n, KINDS[v], known.get(v), n_lots=n_lots, seed=seed, stream=stream).lots
        for stream, v in enumerate(population.variables)
    }
    for k in range(n_lots):
        devices = population.sample_parameters(n, seed=seed + 1 + k)
        _, pairs, _ = correlations(devices, population.variables)
        found: dict[str, Any] = {v: of[k] for v, of in lots.items()}
        try:
            yield replace(population, correlation=pairs, **found)
        except PopulationError:
            yield None


def _fitted(marginal: Marginal, variable: str) -> Bounded:
    if not isinstance(marginal, Bounded):
        raise PopulationError(
            f"{variable} is no Beta and not uniform; the uncertainty from few devices is known of fitted variables "
            "(softclose calibrate)"
        )
    return marginal


def write_calibration(calibration: Calibration, path: str | Path) -> None:
    """Write the population as TOML that `load_population` accepts; intervals, goodness of fit and notes as comments."""
    lines = [
        calibration.population.description,
        f"{'E' if calibration.population.E else 'K and M'} of each device with a plate area of "
        f"{calibration.population.plate_area():g} µm²; campaigns with this population use that area",
        f"fitted number: value [{100.0 * calibration.confidence:g} % interval]",
    ]
    for v, f in calibration.fits.items():
        lines.append(f"{v} [{UNITS[v]}], {KINDS[v]}; Cramér-von Mises {f.statistic:.4f}, p = {f.p_value:.3f}")
        for name, e in f.numbers.items():
            if KINDS[v] == "beta" or name not in ("alpha", "beta"):
                lines.append(f"  {name}: {e.value:.6g} [{e.interval[0]:.6g}, {e.interval[1]:.6g}]")
    lines += [f"note: {note}" for note in calibration.notes]
    write_population(calibration.population, path, lines)


def _check_settings(
    bounds: Mapping[str, tuple[float, float]],
    variables: tuple[str, ...],
    parameters: FloatArray,
    n_bootstrap: int,
    confidence: float,
) -> None:
    for v, (lower, upper) in bounds.items():
        if v not in variables:
            raise MeasurementError(f"bounds are given for {v!r}; known variables: {', '.join(variables)}")
        column = parameters[:, variables.index(v)]
        if not lower <= column.min() <= column.max() <= upper or not lower < upper:
            raise MeasurementError(
                f"the bounds of {v} are {lower:g} to {upper:g} {UNITS[v]}, but devices reach from "
                f"{column.min():.5g} to {column.max():.5g}: widen them, or leave them out"
            )
    if n_bootstrap < 20:
        raise MeasurementError(f"n_bootstrap is {n_bootstrap}; intervals need at least 20 (500 is usual)")
    if not 0.0 < confidence < 1.0:
        raise MeasurementError(f"confidence is {confidence:g}; it must lie between 0 and 1")
