"""Owns the conditions that every analysis is tried under: settings that turn each on, and pairs of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import softclose
from softclose import Pulse, Waveform
from softclose.settings import CampaignConfig, load_config

DRIVE = Waveform([Pulse(0.0, 4.4, 7.25, 111.6), Pulse(56.5, 19.0, float("inf"), 75.0)])
"""A drive under which switches of the current lot differ: some land softly, some hard, a few miss."""

TABLES: dict[str, Any] = {
    "celsius": [-40, 20, 85],
    "stiffness": [1.06, 1.0, 0.93],
    "gap_um": [-0.02, 0.0, 0.03],
    "travel_um": [-0.02, 0.0, 0.03],
    "low_C": -40,
    "high_C": 85,
}
MODES = str(Path(softclose.__file__).parent / "presets" / "modes" / "plate.toml")

CONDITIONS: dict[str, dict[str, Any]] = {
    "trim by pull-in": {"trim": {"measured": "pull-in", "pull_in_error": 0.02}},
    "trim by resonance": {"trim": {"measured": "resonance", "resonance_error": 0.02}},
    "trim by both": {"trim": {"measured": "pull-in and resonance"}},
    "trim in bins": {"trim": {"measured": "pull-in", "bins": 4}},
    "learned trim": {"trim": {"measured": "contact times", "actuations": 8}},
    "bandwidth": {"amplifier": {"bandwidth_kHz": 60.0, "order": 2}},
    "gain, offset and delay": {"amplifier": {"gain": 1.02, "offset_volts": 1.0, "delay_us": 2.0}},
    "slew and resolution": {"amplifier": {"slew_volts_per_us": 20.0, "resolution_volts": 0.5}},
    "gain errors": {"amplifier": {"gain_error": 0.03}},
    "clock errors": {"amplifier": {"time_error": 0.02}},
    "temperature": {"temperature": TABLES},
    "worst temperature": {"temperature": TABLES | {"worst_of": 3}},
    "quality factor": {"model": {"quality_factor": 12.0}},
    "film": {"model": {"film_viscosity_uPa_s": 0.4}},
    "two modes": {"model": {"name": "reduced-order", "modes": MODES}, "compute": {"rtol": 1e-7}},
    "model error": {"model_error": {"force": 0.04, "time": 0.02}},
    "worst model error": {"model_error": {"force": 0.02, "time": 0.01, "counts": "worst"}},
    "closed in time": {"objective": {"closed_by_us": 80.0}},
}
"""Name -> what a configuration says."""

APART = ("trim", "temperature", "model_error")
"""Sections of which two conditions exclude each other, since each says the same thing otherwise."""


def merged(*names: str) -> dict[str, Any]:
    """Several conditions in one configuration."""
    data: dict[str, Any] = {}
    for name in names:
        for section, keys in CONDITIONS[name].items():
            data[section] = data.get(section, {}) | keys
    return data


def compatible(names: tuple[str, ...]) -> bool:
    """Whether no two of them say the same thing otherwise."""
    said = [(section, key) for name in names for section, keys in CONDITIONS[name].items() for key in keys]
    sections = [section for name in names for section in CONDITIONS[name] if section in APART]
    losses = any("quality_factor" in CONDITIONS[n].get("model", {}) for n in names)
    modes = any("modes" in CONDITIONS[n].get("model", {}) for n in names)
    return len(set(said)) == len(said) and len(set(sections)) == len(sections) and not (losses and modes)


def config(*names: str, **more: Any) -> CampaignConfig:
    """A campaign under these conditions. more: further sections."""
    data = merged(*names)
    for section, keys in more.items():
        data[section] = data.get(section, {}) | keys
    return load_config(data)
