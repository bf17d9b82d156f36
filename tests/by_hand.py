"""Owns the slow, obvious way of a switch: its lot drawn and each switch simulated under its own drive, one by one.

It knows every condition by its formula and nothing of the chain that composes them: what analyses are held against.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import ndtri

from softclose import Pulse, Trace, Waveform, simulate
from softclose.conditions.amplifier import deliver
from softclose.conditions.learning import NEVER_US, OVERDRIVE, TailoredByLearning
from softclose.conditions.trim import Trim
from softclose.evaluate.chain import chain_of
from softclose.metrics.objective import Judged
from softclose.population.population import index_uniforms
from softclose.settings import CampaignConfig

MEASUREMENT, DRIVE, TEMPERATURE, TIMING, MODEL = 7_100_000, 7_200_000, 7_300_000, 7_500_000, 7_600_000


def rows(
    config: CampaignConfig, n: int, *, seed: int, stream: int = 0, sampling: str = "monte-carlo"
) -> list[dict[str, float]]:
    """Every switch of an ensemble, as a dictionary of its columns."""
    population = config.build_population()
    u = {0: population.uniforms(n, seed=seed, sampling=sampling, stream=stream)}  # type: ignore[arg-type]
    for key in (MEASUREMENT, DRIVE, TEMPERATURE, TIMING, MODEL):
        u[key] = index_uniforms(n, seed=seed, start=0, stream=stream + key)
    return at(config, u)


def at(config: CampaignConfig, u: dict[int, Any], population: Any = None) -> list[dict[str, float]]:
    """Every switch at given uniform numbers; population: where they come from, if not from what is believed."""
    believed = config.build_population()
    drawn = believed if population is None else population
    switches = drawn.switches(drawn.quantile(u[0]))
    found = [dict(zip("DGKM", map(float, s), strict=True)) for s in switches]
    wrong = config.model_error
    if wrong.counts == "mean" and (wrong.force or wrong.time):
        z = ndtri(np.clip(u[MODEL][:, :2], 1e-12, 1 - 1e-12))
        found = [mistaken(row, wrong.force * f, wrong.time * t) for row, (f, t) in zip(found, z, strict=True)]
        switches = np.array([[row[name] for name in "DGKM"] for row in found])
    t = config.trim
    if t.measured not in ("nothing", "contact times"):
        trim = Trim(
            population=believed, device=chain_of(config).device, measured=t.measured, pull_in_error=t.pull_in_error,
            resonance_error=t.resonance_error, bins=t.bins, scaled=t.scaled,
        )  # fmt: skip
        z = ndtri(np.clip(u[MEASUREMENT][:, :2], 1e-12, 1 - 1e-12))
        read = trim.true(switches) * np.maximum(1.0 + z * [t.pull_in_error, t.resonance_error], 0.1)
        scales = trim.scales(read)
        for row, a, b in zip(found, scales.volts, scales.times, strict=True):
            row["a"], row["b"] = float(a), float(b)
    if t.measured == "contact times":
        learned = next(c for c in chain_of(config).conditions if isinstance(c, TailoredByLearning)).learned
        z = ndtri(np.clip(u[TIMING][:, 0], 1e-12, 1 - 1e-12))
        told = [actuated(config, row, learned.protocol, float(e)) for row, e in zip(found, z, strict=True)]
        scales = learned.trim.scales(learned.estimate(np.array(told)))
        for row, a, b in zip(found, scales.volts, scales.times, strict=True):
            row["a"], row["b"] = float(a), float(b)
    if config.amplifier.scatters:
        z = ndtri(np.clip(u[DRIVE][:, :2], 1e-12, 1 - 1e-12))
        for row, (gain, clock) in zip(found, z, strict=True):
            row["gain"] = max(1.0 + config.amplifier.gain_error * gain, 0.05)
            row["clock"] = max(1.0 + config.amplifier.time_error * clock, 0.05)
    temperature = config.temperature
    if temperature.celsius and not temperature.worst_of:
        celsius = temperature.low_C + (temperature.high_C - temperature.low_C) * u[TEMPERATURE][:, 0]
        found = [heated(config, row, c) for row, c in zip(found, celsius, strict=True)]
    return found


def mistaken(row: dict[str, float], force: float, time: float) -> dict[str, float]:
    """A switch of which the model has the force and the times wrong."""
    k, m = row["K"] / (1.0 + force), row["M"] / (1.0 + force) * (1.0 + time) ** 2
    return row | {"K": k, "M": m, "force_error": force, "time_error": time}


def cases(config: CampaignConfig, row: dict[str, float]) -> list[dict[str, float]]:
    """A switch in every case in which it is tried."""
    t, w = config.temperature, config.model_error
    found = [row]
    if w.counts == "worst":
        ends = [(0.0, 0.0), (-w.reach * w.force, 0.0), (w.reach * w.force, 0.0)]
        ends += [(0.0, -w.reach * w.time), (0.0, w.reach * w.time)]
        found = [mistaken(row, f, s) for f, s in ends]
    if t.worst_of:
        tried = [t.low_C + (t.high_C - t.low_C) * k / (t.worst_of - 1) for k in range(t.worst_of)]
        found = [heated(config, each, celsius) for each in found for celsius in tried]
    return found


def heated(config: CampaignConfig, row: dict[str, float], celsius: float) -> dict[str, float]:
    """A switch at a temperature, from the tables."""
    t = config.temperature
    return row | {
        "D": row["D"] + (np.interp(celsius, t.celsius, t.travel_um) if t.travel_um else 0.0),
        "G": row["G"] + (np.interp(celsius, t.celsius, t.gap_um) if t.gap_um else 0.0),
        "K": row["K"] * (np.interp(celsius, t.celsius, t.stiffness) if t.stiffness else 1.0),
    }


def actuated(config: CampaignConfig, row: dict[str, float], protocol: Any, error: float) -> tuple[float, float]:
    """Threshold and mean contact time of one switch, step by step."""

    def first_contact(volts: float) -> float:
        drive = Waveform([Pulse(0.0, config.waveform.min_rise_us, math.inf, min(volts, config.waveform.max_volts))])
        return float(model(config, row, delivered(config, drive, 1.0, config.model.horizon_us)).first_contact_us[0])

    low, high = protocol.lowest_V, protocol.highest_V
    for _ in range(protocol.actuations - protocol.timed):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if math.isfinite(first_contact(middle)) else (middle, high)
    threshold = math.sqrt(low * high)
    time = first_contact(OVERDRIVE * threshold) + protocol.error_us / math.sqrt(protocol.timed) * error
    return threshold, min(max(time, 1e-3), NEVER_US) if math.isfinite(time) else math.inf


def delivered(config: CampaignConfig, command: Waveform, gain: float, horizon_us: float) -> Any:
    """What the amplifier makes of a command."""
    if config.amplifier.is_ideal:
        return Waveform([replace(p, volts=p.volts * gain) for p in command.pulses])
    return deliver(config.amplifier, command, horizon_us, gain)


def model(
    config: CampaignConfig, row: dict[str, float], drive: Any, horizon_us: float | None = None, **outputs: Any
) -> Any:
    """One switch under one drive, by the shipped model."""
    m, compute = config.model, config.compute
    losses = m.build_losses()
    return simulate(
        [[row[name] for name in "DGKM"]],
        drive,
        horizon_us=m.horizon_us if horizon_us is None else horizon_us,
        restitution=m.restitution,
        plate_area_um2=m.plate_area_um2,
        rtol=compute.rtol,
        max_volts=math.inf,
        losses=None if losses.none else losses,
        modes=config.build_reduced_order() if m.name == "reduced-order" else None,
        **outputs,
    )


def own_drive(
    config: CampaignConfig,
    row: dict[str, float],
    waveform: Any,
    *,
    tailored: bool = True,
    horizon_us: float | None = None,
) -> tuple[Any, float]:
    """The drive of one switch, and by what its times are scaled."""
    a, b = (row.get("a", 1.0), row.get("b", 1.0)) if tailored else (1.0, 1.0)
    gain, clock = row.get("gain", 1.0), row.get("clock", 1.0)
    if isinstance(waveform, Trace):
        return Trace(waveform.times_us * b * clock, waveform.volts * a * gain), b * clock
    if tailored and config.trim.measured != "nothing" and config.trim.keep_limits:
        peak = waveform.max_voltage(config.model.horizon_us)
        a = min(a, config.waveform.max_volts / peak)
        b = max(b, config.waveform.min_rise_us / min(p.rise_us for p in waveform.pulses))
    b *= clock
    command = Waveform([Pulse(p.start_us * b, p.rise_us * b, p.peak_us * b, p.volts * a) for p in waveform.pulses])
    return delivered(config, command, gain, (horizon_us or config.model.horizon_us) * b), b


def respond(config: CampaignConfig, lot: list[dict[str, float]], waveform: Any, *, tailored: bool = True) -> Judged:
    """What every switch does: simulated by itself, in each case that is tried."""
    speed, closed, settling, status = [], [], [], []
    for row in lot:
        drive, b = own_drive(config, row, waveform, tailored=tailored)
        each = [model(config, switch, drive, config.model.horizon_us * b) for switch in cases(config, row)]
        v = [float(r.max_contact_speed[0]) for r in each]
        speed.append(max((s for s in v if not math.isnan(s)), default=math.nan))
        closed.append(all(bool(r.closed[0]) for r in each))
        settling.append(max(float(r.settling_us[0]) for r in each))
        status.append(max(int(r.status[0]) for r in each))
    return Judged(
        max_contact_speed=np.array(speed),
        closed=np.array(closed),
        status=np.array(status, dtype=np.int8),
        settling_us=np.array(settling),
    )
