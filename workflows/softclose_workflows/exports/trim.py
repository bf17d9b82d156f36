"""Owns trim for the test floor: from what was measured on a switch to the scales of its drive."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from softclose.arrays import FloatArray
from softclose.conditions.learning import TailoredByLearning
from softclose.conditions.trim import Trim, given_scales
from softclose.conditions.trim import trim_of as of_section
from softclose.datafiles import parsed_columns
from softclose.device.drives import scaled
from softclose.evaluate import draw
from softclose.evaluate.chain import chain_of
from softclose.population.measurements import NAMES, read_devices
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose.waveform.scales import Scales
from softclose_workflows.errors import ExportError
from softclose_workflows.exports.tables import cell

COLUMNS = ("pull_in_V", "resonance_kHz")
"""Measured quantities, as the columns of tables are called."""

TOLD = ("threshold_V", "contact_time_us")
"""What the actuations of a switch tell, where contact times are all that is known."""

_N_USUAL = 4096
"""Switches whose measured values say what is usual."""

_SPAN = 4.0
"""The table reaches so many standard deviations of the lot to both sides."""


def trim_of(config: CampaignConfig) -> Trim:
    """The campaign's trim. Raises ExportError where it has none."""
    if config.trim.measured == "nothing":
        raise ExportError(
            "this campaign drives every switch alike (trim.measured is nothing): there is nothing to scale; "
            "run one with [trim], such as the preset current-trim"
        )
    return of_section(config.trim, chain_of(config).around)


def _learner(config: CampaignConfig) -> TailoredByLearning:
    """What the campaign learns from contact times."""
    return next(c for c in chain_of(config).conditions if isinstance(c, TailoredByLearning))


def _given(config: CampaignConfig, asked: Scales, waveform: Waveform) -> Scales:
    """What of the scales asked for is given under a waveform."""
    return given_scales(config.trim, chain_of(config).around, asked, waveform)


def used_columns(trim: Trim) -> tuple[str, ...]:
    """Columns of the quantities that are measured."""
    return TOLD if trim.measured == "contact times" else tuple(COLUMNS[i] for i in trim.columns)


def drive_of(
    config: CampaignConfig, waveform: Waveform, *, pull_in_V: float | None, resonance_kHz: float | None
) -> tuple[Waveform, Scales]:
    """The drive of one switch of which this was measured, and its scales within the limits. Raises ExportError."""
    trim = trim_of(config)
    if trim.measured == "contact times":
        raise ExportError(
            "this campaign learns from contact times: give what the actuations told in a table "
            f"(export STORE trim --devices CSV, columns {' and '.join(TOLD)})"
        )
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
    scales = _given(config, trim.scales(measured), waveform)
    drive = scaled(waveform, float(scales.volts[0]), float(scales.times[0]))
    assert isinstance(drive, Waveform)
    return drive, scales


def device_table(
    config: CampaignConfig, waveform: Waveform, path: Path, columns: Mapping[str, str] | None = None
) -> str:
    """A CSV of measured devices with the scales of each one's drive behind them; columns: theirs by ours."""
    names = used_columns(trim_of(config))
    found = read_devices(path, names, columns=columns)
    return _csv(config, waveform, np.stack([found.values[name] for name in names], axis=1), found.names)


def scales_table(
    config: CampaignConfig, drive: Waveform, *, rows: int, devices: Path | None, columns: str | None
) -> str:
    """The table of measured devices in a CSV file, or, without one, of as many values of what may be measured."""
    if devices is None:
        return grid_table(config, drive, rows)
    return device_table(config, drive, devices, parsed_columns(columns, NAMES))


def grid_table(config: CampaignConfig, waveform: Waveform, rows: int) -> str:
    """Scales over the range of what may be measured: `rows` values of each quantity, or one of each bin."""
    trim = trim_of(config)
    if trim.bins:
        axes = [trim.bins_of(column)[1] for column in trim.columns]
    else:
        lot = draw(config, _N_USUAL, seed=0, sampling="sobol")
        if trim.measured == "contact times":
            usual = np.column_stack([lot["threshold"], lot["contact_time"]])
        else:
            usual = trim.true(lot.switches)[:, trim.columns]
        middle, reach = usual.mean(axis=0), _SPAN * usual.std(axis=0)
        low = np.maximum(middle - reach, 0.5 * usual.min(axis=0))
        axes = [np.linspace(a, b, rows) for a, b in zip(low, middle + reach, strict=True)]
    return _csv(config, waveform, np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], axis=1), None)


def _csv(config: CampaignConfig, waveform: Waveform, values: FloatArray, devices: tuple[str, ...] | None) -> str:
    asked = trim_of(config).scales(_measured(config, values))
    given = _given(config, asked, waveform)
    limited = (given.volts != asked.volts) | (given.times != asked.times)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = used_columns(trim_of(config))
    writer.writerow([*(["device"] if devices else []), *names, "voltage_scale", "time_scale", "at_a_limit"])
    for i, row in enumerate(values):
        scales = [f"{given.volts[i]:.6f}", f"{given.times[i]:.6f}", int(limited[i])]
        writer.writerow([*([cell(devices[i])] if devices else []), *(f"{value:.6g}" for value in row), *scales])
    return text.getvalue()


def _measured(config: CampaignConfig, values: FloatArray) -> FloatArray:
    """(n, 2) pull-in voltage and resonance of what was measured, NaN where it was not."""
    trim = trim_of(config)
    if trim.measured == "contact times":
        return _learner(config).learned.estimate(values)
    found = np.full((len(values), len(COLUMNS)), np.nan)
    found[:, trim.columns] = values
    return found
