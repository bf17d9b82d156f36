"""Owns the campaign of one's own that a fit leads to: the lot about the fitted switch, and its device model, as files.

The lot keeps the scatter of the campaign that the fit began with, scaled to the fitted switch; where enough devices
were measured, K and M have the scatter of those.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from softclose.arrays import FloatArray
from softclose.device.device import Device
from softclose.device.told import switches_of
from softclose.evaluate.chain import device_of
from softclose.identify.least_squares import Identified
from softclose.identify.model import Model
from softclose.population import Population
from softclose.population.files import write_population
from softclose.population.fit import estimate
from softclose.population.measurements import MIN_DEVICES
from softclose.settings import CampaignConfig, load_config
from softclose.settings.config import WRITTEN_OUT
from softclose.switch.plate import resonance
from softclose.tables import toml_text

LARGEST_ERROR = 0.3
"""What `model_error` takes at most: a model that misses by more is none."""
_N_LOT = 4096
"""Sobol switches whose K and M stand for a lot that is told by other variables."""


def model_of(config: CampaignConfig, rise_us: float = 0.0) -> Model:
    """What a fit begins with: the mean switch of a campaign's lot, and its device model."""
    from softclose.device.told import mean_switch

    device = device_of(config)
    return Model(switch=mean_switch(config.build_population(), device), device=device, rise_us=rise_us)


def own_lot(base: Population, begun: Model, found: Identified) -> Population:
    """The lot about a fitted switch.

    Parameters
    ----------
    base : Population
        The lot that the fit began with: gap, travel and the relative scatter of K and M are its.
    begun : Model
        Where the fit began.
    found : Identified
        The fit. Where it had `MIN_DEVICES` devices or more, K and M have their scatter, as Betas.

    Returns
    -------
    Population
        Told by pull-in voltage and resonance, or K and f, where the base is, else by K and M.
    """
    area = found.device.plate_area_um2
    stiffer, heavier = found.switch[2:] / begun.switch[2:]
    if len(found.factors) >= MIN_DEVICES:
        of_each = found.switch[2:] * np.array(list(found.factors.values()))
        return _by_stiffness_and_mass(base, area, of_each)
    if base.variables[2:] == ("K", "M"):
        means = {"K": base.mean_K * stiffer, "M": base.mean_M * heavier}
    elif base.variables[2:] in (("K", "f"), ("U_pi", "f")):
        tone = float(resonance(found.switch) / resonance(begun.switch))
        changed = {"K": stiffer, "U_pi": _closes(found.device, found.switch) / _closes(begun.device, begun.switch)}
        means = {v: getattr(base, v).mean * changed.get(v, tone) for v in base.variables[2:]}
    else:
        p = base.sample_parameters(_N_LOT, seed=0, sampling="sobol")
        return _by_stiffness_and_mass(base, area, switches_of(base, begun.device, p)[:, 2:] * [stiffer, heavier])
    return replace(base.with_means(means), plate_area_um2=area)


def _closes(device: Device, switch: FloatArray) -> float:
    return float(device.closing_voltage(switch[None, :])[0])


def _by_stiffness_and_mass(base: Population, area: float, of_each: FloatArray) -> Population:
    """A lot of these K [N/m] and M [µg], (n, 2), as Betas with their rank correlation."""
    from scipy.stats import spearmanr

    rho = float(spearmanr(of_each).statistic)
    pairs = (("K", "M", round(float(np.clip(rho, -0.99, 0.99)), 4)),)
    k, m = (estimate(column, "beta") for column in of_each.T)
    return Population(name=base.name, D=base.D, G=base.G, K=k, M=m, plate_area_um2=area, correlation=pairs)


def write_own_campaign(config: CampaignConfig, begun: Model, found: Identified, path: str | Path) -> tuple[Path, ...]:
    """Write the campaign that goes on from a fit; returns its files: the campaign, its lot, its modes if it has some.

    The campaign differs from the one that the fit began with by its lot, its model and the error that the fitted model
    leaves. The files of lot and modes stand beside it, by names of their own.
    """
    target = Path(path)
    lot, modes = target.with_suffix(".lot.toml"), target.with_suffix(".modes.toml")
    population = replace(own_lot(config.build_population(), begun, found), name=target.stem)
    comments = [f"{name}: {value:.6g}, held" for name, value in found.fixed.items()]
    for name, told in found.parameters.items():
        low, high = told.interval
        within = f"{low:.6g} to {high:.6g} ({100.0 * found.confidence:.0f} %)"
        said = "not told by the readings" if math.isinf(high) else within
        comments.append(f"{name}: {told.value:.6g}, {said}")
    write_population(population, lot, comments)
    data = _differences(config.to_dict(), load_config({}).to_dict())
    losses = found.device.losses
    model = data.setdefault("model", {})
    model.pop("plate_area_um2", None)
    model["restitution"] = found.device.restitution
    if "film" in found.values:
        sizes = {name: getattr(losses, name) for name in ("film_length_um", "film_width_um")}
        model |= {"film_viscosity_uPa_s": float(np.max(losses.film_viscosity_uPa_s))} | sizes
    files = [target, lot]
    if found.device.modes is None:
        if "Q" in found.values:
            model["quality_factor"] = float(np.max(losses.quality_factor))
    else:
        modes.write_text(toml_text(found.device.modes.to_dict()), "utf-8")
        model["modes"] = modes.name
        files.append(modes)
    data.setdefault("population", {})["name"] = lot.name
    left = {"force": found.force_error, "time": found.time_error}
    errors = {name: round(min(x, LARGEST_ERROR), 3) for name, x in left.items() if not math.isnan(x)}
    if any(errors.values()):
        data["model_error"] = data.get("model_error", {}) | errors
    if "compute" in data:
        data["compute"].pop("block_switches", None)
    target.write_text(toml_text(data), "utf-8")
    return tuple(files)


def _differences(data: Mapping[str, Any], usual: Mapping[str, Any]) -> dict[str, Any]:
    """What a configuration says otherwise than the defaults do; lots and modes have files of their own."""
    found: dict[str, Any] = {}
    for section, keys in data.items():
        if section not in WRITTEN_OUT:
            changed = {k: v for k, v in keys.items() if v != usual[section].get(k)}
            if changed:
                found[section] = changed
    return found
