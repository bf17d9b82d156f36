"""Owns trim for the test floor: from what was measured on a switch to the scales of its drive."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from softclose.config import CampaignConfig
from softclose.population.measurements import read_devices
from softclose.population.trim import Scales, Trim
from softclose.trimmed import limited_scales, scaled
from softclose.waveform import FloatArray, Waveform
from softclose_workflows.errors import ExportError

COLUMNS = ("pull_in_V", "resonance_kHz")
"""Measured quantities, as the columns of tables are called."""

_SPAN = 4.0
"""The table reaches so many standard deviations of the lot to both sides."""


def trim_of(config: CampaignConfig) -> Trim:
    """The campaign's trim. Raises ExportError where it has none."""
    trim = config.build_trim()
    if trim is None:
        raise ExportError(
            "this campaign drives every switch alike (trim.measured is nothing): there is nothing to scale; "
            "run one with [trim], such as the preset current-trim"
        )
    return trim


def used_columns(trim: Trim) -> tuple[str, ...]:
    """Columns of the quantities that are measured."""
    return tuple(COLUMNS[i] for i in trim.columns)


def drive_of(
    config: CampaignConfig, waveform: Waveform, *, pull_in_V: float | None, resonance_kHz: float | None
) -> tuple[Waveform, Scales]:
    """The drive of one switch of which this was measured, and its scales within the limits. Raises ExportError."""
    trim = trim_of(config)
    given = dict(zip(COLUMNS, (pull_in_V, resonance_kHz), strict=True))
    needed = used_columns(trim)
    options = dict(zip(COLUMNS, ("--pull-in", "--resonance"), strict=True))
    for name, value in given.items():
        if (value is None) == (name in needed):
            raise ExportError(
                f"{options[name]} is {'missing' if value is None else 'given'}; this campaign measures "
                f"{trim.measured}: give {' and '.join(options[n] for n in needed)}"
            )
    measured = np.array([[np.nan if v is None else v for v in given.values()]])
    scales = limited_scales(config, trim.scales(measured), waveform)
    return scaled(waveform, float(scales.voltage[0]), float(scales.time[0])), scales


def device_table(config: CampaignConfig, waveform: Waveform, path: Path) -> str:
    """A CSV of measured devices with the scales of each one's drive behind them."""
    trim = trim_of(config)
    devices, values, _ = read_devices(path, used_columns(trim))
    measured = np.full((len(values), len(COLUMNS)), np.nan)
    measured[:, trim.columns] = values
    return _csv(config, waveform, trim, measured, devices)


def grid_table(config: CampaignConfig, waveform: Waveform, rows: int) -> str:
    """Scales over the range of what may be measured: `rows` values of each quantity, or one of each bin."""
    trim = trim_of(config)
    axes: list[FloatArray] = []
    for column in trim.columns:
        if trim.bins:
            axes.append(trim.bins_of(column)[1])
            continue
        values = trim.true(trim.population.sample(4096, seed=0, sampling="sobol"))[:, column]
        middle, reach = values.mean(), _SPAN * values.std()
        axes.append(np.linspace(max(middle - reach, 0.5 * values.min()), middle + reach, rows))
    grid = np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], axis=1)
    measured = np.full((len(grid), len(COLUMNS)), np.nan)
    measured[:, trim.columns] = grid
    return _csv(config, waveform, trim, measured, None)


def _csv(
    config: CampaignConfig, waveform: Waveform, trim: Trim, measured: FloatArray, devices: tuple[str, ...] | None
) -> str:
    asked = trim.scales(measured)
    given = limited_scales(config, asked, waveform)
    limited = (given.voltage != asked.voltage) | (given.time != asked.time)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        [*(["device"] if devices else []), *used_columns(trim), "voltage_scale", "time_scale", "at_a_limit"]
    )
    for i in range(len(measured)):
        values = [f"{measured[i, column]:.6g}" for column in trim.columns]
        scales = [f"{given.voltage[i]:.6f}", f"{given.time[i]:.6f}", int(limited[i])]
        writer.writerow([*([devices[i]] if devices else []), *values, *scales])
    return text.getvalue()
