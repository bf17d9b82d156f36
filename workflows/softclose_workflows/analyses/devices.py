"""Owns how uncertain a stored design's figures are because few devices were measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from softclose.evaluate.pieces import Mapper, here
from softclose.population.calibrate import calibrate
from softclose.population.measurements import read_measurements
from softclose.uncertainty.devices import DevicesError, Propagated, apart
from softclose.uncertainty.devices import propagate as propagate_devices
from softclose_workflows.analyses.chosen import Chosen, choose
from softclose_workflows.run.needs import check_fresh
from softclose_workflows.tell.console import OnStep
from softclose_workflows.tell.labels import estimated, in_percent
from softclose_workflows.tell.plain import finite
from softclose_workflows.tell.tables import with_interval

FEW = 30
"""Devices below which the intervals are said to be what they are (docs/measurements/coverage.md)."""
HELD = {"v_u": 0.92, "p_nc": 0.94}
"""How often intervals of a stated 0.95 held of lots that twelve devices tell of, without known bounds (there)."""


def propagate(
    path: str,
    measurements: str,
    *,
    columns: Mapping[str, str] | None = None,
    candidate: int | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    n_lots: int = 200,
    n_switches: int = 4_000,
    seed: int = 0,
    any_lot: bool = False,
    mapper: Mapper = here,
    listener: OnStep | None = None,
) -> tuple[Chosen, Propagated, list[str]]:
    """A stored waveform on lots that a file's devices may have come from, and what is to be said of them.

    any_lot: devices of another lot than the campaign's are taken too. Raises MeasurementError, DevicesError.
    """
    check_fresh(n_switches, 1)
    chosen = choose(path, candidate)
    devices = read_measurements(measurements, columns=columns)
    fitted = calibrate(
        devices, bounds=bounds, plate_area_um2=chosen.config.model.plate_area_um2, n_bootstrap=20, seed=seed
    )
    own, area = chosen.config.build_population(), chosen.config.model.plate_area_um2
    other, shifted = apart(own, fitted.population, len(devices.device), area)
    if other and not any_lot:
        raise DevicesError(
            f"the devices of {measurements} are of another lot than {own.name!r}: {'; '.join(other)}. Give the devices "
            "of the campaign's lot, or say that the waveform is to be judged on another one (--any-lot)"
        )
    notes = [f"the devices are of a shifted or of another lot: {said}" for said in (*other, *shifted)]
    found = propagate_devices(
        chosen.config,
        chosen.waveform,
        fitted.population,
        len(devices.device),
        bounds=bounds,
        n_lots=n_lots,
        n_switches=n_switches,
        seed=seed,
        mapper=mapper,
        listener=listener,
    )
    return chosen, found, notes


def said(chosen: Chosen, found: Propagated) -> list[str]:
    """A line a figure: what it is, what the switches leave open, and what the devices do."""
    a, level = found.assessment, in_percent(found.confidence)
    rows = (
        ("v_u [cm/s]", "v_u_cm_s", a.v_u_cm_s, a.v_u_interval, 1.0),
        ("open [%]", "p_nc", a.p_nc, a.p_nc_intervals.wilson, 100.0),
        ("g [cm/s]", "g_cm_s", a.g_cm_s, a.g_interval, 1.0),
    )
    lines = [
        f"candidate {chosen.candidate} ({chosen.why}) on the lot of {found.n_devices} devices; {level} intervals: by "
        f"{a.n:,} switches, and by the devices"
    ]
    for label, name, value, by_switches, factor in rows:
        (low, high), (first, last) = found.interval(name), by_switches
        _, by_devices = estimated(factor * value, factor * low, factor * high)
        lines.append(f"  {label:11} {with_interval(factor * value, factor * first, factor * last)}   {by_devices}")
    if found.n_devices < FEW:
        lines.append(
            f"{found.n_devices} devices are few: of 12, without known bounds, intervals of a stated 95 % were measured "
            f"to hold v_u {100.0 * HELD['v_u']:.0f} % of the time, the share left open {100.0 * HELD['p_nc']:.0f} %"
        )
    if found.n_failed:
        lines.append(f"{found.n_failed} of {len(found.p_nc)} draws of devices are no population and left out")
    return lines


def to_json(chosen: Chosen, found: Propagated, notes: list[str]) -> dict[str, Any]:
    """Plain values."""
    plain: dict[str, Any] = finite(
        {
            "candidate": chosen.candidate,
            "n_devices": found.n_devices,
            "notes": notes,
            "n_lots": len(found.p_nc),
            "n_failed": found.n_failed,
            "confidence": found.confidence,
            "assessment": found.assessment.to_dict(),
            "by_devices": {name: list(found.interval(name)) for name in ("v_u_cm_s", "p_nc", "g_cm_s")},
            "lots": {
                "v_u_cm_s": found.v_u_cm_s.tolist(),
                "p_nc": found.p_nc.tolist(),
                "g_cm_s": found.g_cm_s.tolist(),
            },
        }
    )
    return plain
