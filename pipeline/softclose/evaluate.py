"""Owns the one place where a configuration meets a waveform: switches × waveform -> responses -> assessment.

Every command and every engine's evaluation goes through here, so that each device model, objective and setting counts
everywhere.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import lru_cache, partial, reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from softclose.conditions.amplifier import deliver, scattered
from softclose.conditions.learning import STEP_VOLTS, Learned, Touch, actuate, protocol_of, step
from softclose.conditions.temperature import heated, spread, worse
from softclose.conditions.trim import limited
from softclose.device.protocol import load_model
from softclose.device.scaled import Scales, Simulate, by_equal_switches, drive_by_drive
from softclose.metrics.objective import Assessment, Response, assess
from softclose.plugins import REDUCED_ORDER, SINGLE_MODE
from softclose.population import Sampling
from softclose.waveform import Drive, FloatArray, Trace, Waveform, WaveformError

N_PARAMETERS = 4
"""D, G, K and M of a switch; the columns behind them are the scales of its drive."""

if TYPE_CHECKING:
    from softclose.device.simulate import Responses
    from softclose.settings import CampaignConfig


def draw(
    config: CampaignConfig,
    n: int,
    *,
    seed: int,
    sampling: Sampling = "monte-carlo",
    start: int = 0,
    stream: int = 0,
) -> FloatArray:
    """Switches `start` to `start + n` of an ensemble of the campaign's lot.

    Returns (n, 4) float64 D, G [µm], K [N/m], M [µg]; where drives are trimmed, or the amplifier's scatter, (n, 6),
    voltage and time scale besides.
    Row i depends on (seed, stream, start + i) and nothing else.
    """
    switches = config.build_population().sample(n, seed=seed, sampling=sampling, start=start, stream=stream)
    lot = _with_drives(config, switches, seed=seed, start=start, stream=stream)
    if not config.temperature.spreads:
        return lot
    return heated(config.temperature, lot, spread(config.temperature, n, seed=seed, start=start, stream=stream))


def _with_drives(config: CampaignConfig, switches: FloatArray, *, seed: int, start: int, stream: int) -> FloatArray:
    """The switches, and the scales of their drives where those differ: by what was measured on them as the population
    has them, or by the amplifier."""
    trim = config.build_trim()
    if trim is None:
        if not config.amplifier.scatters:
            return switches
        scales = scattered(config.amplifier, len(switches), seed=seed, start=start, stream=stream)
        return np.column_stack([switches, scales])
    if trim.measured == "contact times":
        learned = learn(config)
        told = actuate(touch_of(config), switches, learned.protocol, seed=seed, start=start, stream=stream)
        return trim.trimmed(switches, learned.estimate(told))
    return trim.trimmed(switches, trim.measure(switches, seed=seed, start=start, stream=stream))


def touch_of(config: CampaignConfig) -> Touch:
    """How the campaign's switches answer steps, each of its own voltage within the drive's limit."""

    def touch(switches: FloatArray, volts: FloatArray) -> FloatArray:
        highest = np.minimum(volts, config.waveform.max_volts)
        lot = np.column_stack([switches, highest / STEP_VOLTS, np.ones(len(switches))])
        return respond(config, lot, step(config.waveform.min_rise_us)).first_contact_us

    return touch


def learn(config: CampaignConfig) -> Learned:
    """What contact times tell of a switch of the campaign's lot."""
    return _learned(json.dumps(config.to_dict(), sort_keys=True))


@lru_cache(maxsize=4)
def _learned(text: str) -> Learned:
    from softclose.settings import CampaignConfig

    config = CampaignConfig.from_dict(json.loads(text))
    trim, settings = config.build_trim(), config.trim
    assert trim is not None
    protocol = protocol_of(
        trim,
        actuations=settings.actuations,
        error_us=settings.contact_time_error_us,
        max_volts=config.waveform.max_volts,
    )
    return Learned.of(trim, protocol, touch_of(config))


def respond(
    config: CampaignConfig, switches: FloatArray, waveform: Drive, *, max_volts: float = math.inf, **outputs: Any
) -> Responses:
    """Responses of switches to one waveform, by the campaign's device model and with its settings.

    switches: (n, 4), each driven by the waveform itself; or (n, 6) as `draw` returns them: where the campaign trims,
    each by the waveform scaled for it, within the limits (ADR 066). Their sampled x and v are those at the time scale
    times `times_us`.
    A waveform goes through the campaign's amplifier; a trace is what one has delivered already.
    Where the campaign tries temperatures (`temperature.worst_of`), each switch's response is that at its worst.
    Where the objective has an instant by which switches have to be closed, `closed` means by then.
    max_volts [V]: above it WaveformError; reference designs and faulty drives are simulated whatever the campaign's
    limit. outputs: `times_us`, `max_impacts`, `dtype` and `threads` of the device model.
    """
    model, compute = config.model, config.compute
    if isinstance(waveform, Waveform) and not config.amplifier.is_ideal:
        waveform.check(max_volts, model.horizon_us)
        waveform, max_volts = deliver(config.amplifier, waveform, model.horizon_us), math.inf
    simulate: Simulate = partial(
        load_model(model.name),
        restitution=model.restitution,
        plate_area_um2=model.plate_area_um2,
        rtol=compute.rtol,
        method=compute.method,
        **{"horizon_us": model.horizon_us, "max_volts": max_volts} | own_settings(config) | outputs,
    )

    def at(lot: FloatArray) -> Responses:
        return _responses(config, simulate, lot, waveform, max_volts=max_volts, times_us=outputs.get("times_us"))

    t = config.temperature
    found = reduce(worse, (at(heated(t, switches, celsius)) for celsius in t.tried)) if t.tried else at(switches)
    limit = config.objective.closed_by_us
    return replace(found, closed=found.closed & (found.settling_us <= limit)) if limit else found


def own_settings(config: CampaignConfig) -> dict[str, Any]:
    """What only the shipped models take: losses where there are any, and modes."""
    losses = config.model.build_losses()
    settings: dict[str, Any] = {} if losses.none else {"losses": losses}
    if config.model.name == REDUCED_ORDER:
        settings["modes"] = config.build_reduced_order()
    return settings


def _responses(
    config: CampaignConfig,
    simulate: Simulate,
    switches: FloatArray,
    waveform: Drive,
    *,
    max_volts: float,
    times_us: Any,
) -> Responses:
    """Every switch under its own drive, where the campaign trims, or under the waveform."""
    model, plain, scatters = config.model, switches[:, :N_PARAMETERS], config.amplifier.scatters
    if switches.shape[1] == N_PARAMETERS or (config.trim.measured == "nothing" and not scatters):
        return simulate(plain, waveform)
    # A scaled drive is the common one on another switch: Eqs. 1-2 scale, losses and further modes do not.
    equal = model.name == SINGLE_MODE and model.build_losses().none
    if not isinstance(waveform, Trace):
        waveform.check(max_volts, model.horizon_us)
    elif not scatters:
        raise WaveformError(
            "a sampled drive is not scaled for a switch: simulate it as it is, on columns D, G, K and M"
        )
    scales = drive_scales(config, switches, waveform)
    if equal:
        return by_equal_switches(simulate, plain, waveform, scales)
    anything = partial(simulate, max_volts=math.inf)
    return drive_by_drive(anything, plain, waveform, scales, horizon_us=model.horizon_us, times_us=times_us)


def drive_scales(config: CampaignConfig, lot: FloatArray, waveform: Drive) -> Scales:
    """The scales of each switch's drive under one waveform; lot: (n, 6)."""
    return limited_scales(config, Scales(voltage=lot[:, 4], time=lot[:, 5]), waveform)


def limited_scales(config: CampaignConfig, asked: Scales, waveform: Drive) -> Scales:
    """What of the scales asked for is given under one waveform: all, unless trim keeps its drive's limits.

    An amplifier's errors know no limits.
    """
    if not config.trim.keep_limits or config.trim.measured == "nothing" or isinstance(waveform, Trace):
        return asked
    return limited(
        asked,
        peak_V=waveform.max_voltage(config.model.horizon_us),
        max_volts=config.waveform.max_volts,
        shortest_rise_us=min(p.rise_us for p in waveform.pulses),
        min_rise_us=config.waveform.min_rise_us,
    )


def judge(config: CampaignConfig, response: Response, *, fresh: bool = False) -> Assessment:
    """Eqs. 7-11 of a response with the campaign's objective.

    fresh: the switches are independent random draws, whatever the campaign trains on, so that intervals hold.
    """
    settings = objective_settings(config)
    return assess(response, **(settings | {"sampling": "monte-carlo"} if fresh else settings))


def evaluate(
    config: CampaignConfig,
    switches: FloatArray,
    waveform: Drive,
    *,
    max_volts: float = math.inf,
    fresh: bool = False,
    threads: int = 1,
) -> Assessment:
    """Assess one waveform on switches; see `respond` and `judge`."""
    return judge(config, respond(config, switches, waveform, max_volts=max_volts, threads=threads), fresh=fresh)


def objective_settings(config: CampaignConfig) -> dict[str, Any]:
    """The keyword arguments of `assess` that a configuration stands for."""
    o = config.objective
    return {
        "form": o.form,
        "risk": o.risk,
        "level": o.level,
        "c1_cm_s": o.c1_cm_s,
        "p_max": o.p_max if o.form == "chance" else None,
        "assured": o.assured,
        "chance_penalty_cm_s": o.chance_penalty_cm_s,
        "limits_cm_s": o.limits_cm_s,
        "min_contact": o.min_contact,
        "undefined_v_u_cm_s": o.undefined_v_u_cm_s,
        "confidence": o.confidence,
        "sampling": config.population.sampling,
    }
