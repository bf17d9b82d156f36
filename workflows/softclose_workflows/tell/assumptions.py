"""Owns what a result rests on, in sentences: the switches, the device model, and what stands between lot and drive."""

from __future__ import annotations

from softclose.conditions.amplifier import AmplifierSection
from softclose.conditions.model_error import ModelErrorSection
from softclose.conditions.trim import TrimSection
from softclose.plugins import REDUCED_ORDER, SINGLE_MODE
from softclose.settings import CampaignConfig
from softclose.settings.model import ModelSection


def assumptions(config: CampaignConfig) -> list[str]:
    """One sentence for each thing that a reader of the figures has to believe, the most consequential first."""
    return [
        *_trim(config.trim),
        _lot(config),
        _model(config.model),
        *_model_error(config.model_error),
        _amplifier(config.amplifier),
        *_errors(config.amplifier),
        *_temperature(config),
        *_opening(config),
    ]


def _lot(config: CampaignConfig) -> str:
    return (
        f"The lot is the population “{config.population.name}”: the figures hold for devices that are distributed "
        "as it says."
    )


def _model(m: ModelSection) -> str:
    if m.name == SINGLE_MODE:
        losses = [
            *([f"a quality factor of {m.quality_factor:g}"] if m.quality_factor else []),
            *([f"a squeezed film of {m.film_viscosity_uPa_s:g} µPa s"] if m.film_viscosity_uPa_s else []),
            *([f"an adhesion of {m.adhesion_uN:g} µN"] if m.adhesion_uN else []),
        ]
        kind = f"a plate with one mode of vibration and {' and '.join(losses) if losses else 'no damping'}"
    elif m.name == REDUCED_ORDER:
        kind = f"the reduced-order model {m.modes or 'written in the store'}"
    else:
        kind = f"the device model {m.name}"
    return f"Each switch is {kind}; it rebounds with {m.restitution:g} of its speed at each impact."


def _model_error(e: ModelErrorSection) -> list[str]:
    facts = [
        *([f"its force by {100 * e.force:g} %"] if e.force else []),
        *([f"its times by {100 * e.time:g} %"] if e.time else []),
    ]
    if not facts:
        return []
    said = f"The device model may be off for the whole lot, {' and '.join(facts)} (standard deviation)"
    if e.counts == "worst":
        return [f"{said}: each switch counts at its worst of either error up to {e.reach:g} standard deviations."]
    return [f"{said}: the figures are those of the lots that it may be, weighed alike."]


def _trim(t: TrimSection) -> list[str]:
    what = {
        "nothing": "",
        "pull-in": f"one measurement a part: its pull-in voltage, to {100 * t.pull_in_error:g} %",
        "resonance": f"one measurement a part: its resonance, to {100 * t.resonance_error:g} %",
        "pull-in and resonance": f"two measurements a part: its pull-in voltage, to {100 * t.pull_in_error:g} %, and "
        f"its resonance, to {100 * t.resonance_error:g} %",
        "contact times": f"{t.actuations} actuations a part, each contact timed to {t.contact_time_error_us:g} µs",
    }[t.measured]
    if not what:
        return []
    shared = f"; parts of the same of {t.bins} bins share a drive" if t.bins else ""
    return [f"Every switch is driven by its own scaled copy of the waveform ({t.scaled}), which needs {what}{shared}."]


def _amplifier(a: AmplifierSection) -> str:
    if a.is_ideal:
        return "The amplifier is ideal: each switch sees exactly the voltage that is commanded."
    facts = [
        *([f"bandwidth {a.bandwidth_kHz:g} kHz (order {a.order})"] if a.bandwidth_kHz else []),
        *([f"slew rate {a.slew_volts_per_us:g} V/µs"] if a.slew_volts_per_us else []),
        *([f"gain {a.gain:g}"] if a.gain != 1.0 else []),
        *([f"offset {a.offset_volts:g} V"] if a.offset_volts else []),
        *([f"delay {a.delay_us:g} µs"] if a.delay_us else []),
        *([f"resolution {a.resolution_volts:g} V"] if a.resolution_volts else []),
        *([f"sample time {a.resolution_us:g} µs"] if a.resolution_us else []),
    ]
    return f"The amplifier is simulated: {', '.join(facts)}."


def _errors(a: AmplifierSection) -> list[str]:
    facts = [
        *([f"gain by {100 * a.gain_error:g} %"] if a.gain_error else []),
        *([f"clock by {100 * a.time_error:g} %"] if a.time_error else []),
    ]
    return [f"From one drive to the next the {' and the '.join(facts)} vary (standard deviation)."] if facts else []


def _temperature(config: CampaignConfig) -> list[str]:
    t = config.temperature
    if not t.celsius:
        return []
    span = f"from {t.low_C:g} to {t.high_C:g} °C"
    if t.worst_of:
        return [f"Each switch counts at the worst of {t.worst_of} temperatures {span}."]
    return [f"Each switch has a temperature of its own {span}."]


def _opening(config: CampaignConfig) -> list[str]:
    if not config.opening.release_us:
        return []
    return [f"The switches are released at {config.opening.release_us:g} µs; until then the voltage holds them."]
