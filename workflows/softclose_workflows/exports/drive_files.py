"""Owns the drive of one candidate as the content of a file: samples, a SPICE source, codes, files of generators."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from softclose.arrays import FloatArray
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import Campaign
from softclose_workflows.analyses.chosen import choose
from softclose_workflows.errors import ExportError
from softclose_workflows.exports.delivered import check_delivered
from softclose_workflows.exports.formats import MEANT_FOR, DriveSettings
from softclose_workflows.exports.instruments import SIGLENT_POINTS, WRITERS, play, write_bytes
from softclose_workflows.exports.pwl import draw, spice_source
from softclose_workflows.exports.samples import CodeScale, codes_text, metadata, sample_times_us, volts_csv
from softclose_workflows.exports.tables import cell
from softclose_workflows.exports.trim import drive_of
from softclose_workflows.run.opening import designed_opening
from softclose_workflows.tell.outputs import write_text
from softclose_workflows.tell.plain import json_text
from softclose_workflows.tell.tables import describe_waveform


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveFile:
    """What goes into a file, and what stands beside it."""

    content: str | bytes
    """The file; bytes where it is no text for a terminal."""
    about: dict[str, Any] = field(default_factory=dict)
    """What FILE.json says of it; empty where the file says all itself."""
    notes: tuple[str, ...] = ()
    """What its user has to know: scales of a trimmed drive, levels at the generator."""

    def write(self, path: Path) -> None:
        """The description first, so that codes never lie about without their scale; then the file."""
        if self.about:
            write_text(path.with_name(path.name + ".json"), json_text(self.about, indent=2) + "\n")
        if isinstance(self.content, bytes):
            write_bytes(path, self.content)
        else:
            write_text(path, self.content)


def drive_file(campaign: Campaign, candidate: int, settings: DriveSettings) -> DriveFile:
    """The drive of one candidate in the format asked for, once its samples are known to be still the waveform.

    Raises
    ------
    ExportError
        For a format that there is not, for settings that a format needs or cannot have, and where the delivered
        samples are too far from the waveform.
    """
    if settings.format not in MEANT_FOR:
        raise ExportError(f"{settings.format!r} is no format of a waveform; give one of {', '.join(sorted(MEANT_FOR))}")
    drive, notes = _drive(campaign, candidate, settings)
    if settings.format == "pwl":
        return _spice(campaign, candidate, drive, settings, notes)
    duration_us = _duration_us(campaign, drive, settings)
    if settings.format in WRITERS:
        return _generator(campaign, candidate, drive, duration_us, settings, notes)
    times_us = sample_times_us(settings.rate_MSps, duration_us)
    if settings.format == "dac":
        return _codes(campaign, candidate, drive, times_us, settings, notes)
    _check(campaign, drive, times_us, drive.voltage(times_us), settings)
    return DriveFile(content=volts_csv(drive, times_us), notes=notes)


def _drive(campaign: Campaign, candidate: int, settings: DriveSettings) -> tuple[Waveform, tuple[str, ...]]:
    """The waveform, or the whole drive, scaled for one switch where its measured values are given; and its scales."""
    drive = Waveform.from_rows(campaign.waveform(candidate))
    if settings.release:
        found = designed_opening(campaign.path, candidate)
        if found is None:
            raise ExportError(f"{campaign.path} designs no opening (opening.release_us): leave --release out")
        drive = (found.plain if found.braked is None else found.braked).released.waveform
    if settings.pull_in_V is None and settings.resonance_kHz is None:
        return drive, ()
    config = CampaignConfig.from_dict(campaign.config)
    drive, scales = drive_of(config, drive, pull_in_V=settings.pull_in_V, resonance_kHz=settings.resonance_kHz)
    return drive, (f"volts × {float(scales.volts[0]):.4f}, times × {float(scales.times[0]):.4f}",)


def _duration_us(campaign: Campaign, drive: Waveform, settings: DriveSettings) -> float:
    if settings.duration_us is not None:
        return settings.duration_us
    if settings.release:
        return float(math.ceil(drive.breakpoints(math.inf)[-1]))
    return float(campaign.config["model"]["horizon_us"])


def _spice(
    campaign: Campaign, candidate: int, drive: Waveform, settings: DriveSettings, notes: tuple[str, ...]
) -> DriveFile:
    line = draw(drive, settings.tolerance_mV * 1e-3)
    _check(campaign, drive, line.times_us, line.volts, settings)
    comments = _comments(campaign, candidate, drive)
    return DriveFile(
        content=spice_source(line, source=settings.source, nodes=settings.nodes, comments=comments), notes=notes
    )


def _codes(
    campaign: Campaign,
    candidate: int,
    drive: Waveform,
    times_us: FloatArray,
    settings: DriveSettings,
    notes: tuple[str, ...],
) -> DriveFile:
    if settings.full_scale_V is None:
        raise ExportError(
            "codes mean nothing without the voltage at the switch that the largest one stands for, amplifier included: "
            f"give --full-scale (the campaign's limit is {campaign.config['waveform']['max_volts']:g} V)"
        )
    scale = CodeScale(
        bits=settings.bits,
        signed=settings.signed,
        rate_MSps=settings.rate_MSps,
        full_scale_V=settings.full_scale_V,
    )
    volts = drive.voltage(times_us)
    codes = scale.encode(volts)
    _check(campaign, drive, times_us, np.asarray(codes * scale.volts_per_code, dtype=np.float64), settings)
    about = metadata(scale, codes, volts)
    comments = [*_comments(campaign, candidate, drive), *(f"{name}: {value}" for name, value in about.items())]
    return DriveFile(
        content=codes_text(codes, comments if settings.header else []),
        about=about | _origin(campaign, candidate),
        notes=notes,
    )


def _generator(
    campaign: Campaign,
    candidate: int,
    drive: Waveform,
    duration_us: float,
    settings: DriveSettings,
    notes: tuple[str, ...],
) -> DriveFile:
    form = settings.format
    rate_MSps = settings.rate_MSps
    if form == "siglent-csv" and duration_us > 0.0:
        rate_MSps = (SIGLENT_POINTS - 1) / duration_us
    played = play(drive, rate_MSps=rate_MSps, duration_us=duration_us, gain=settings.gain)
    content = WRITERS[form](played)
    times_us = np.arange(played.volts.size) / played.rate_MSps
    _check(campaign, drive, times_us, played.volts * played.gain, settings)
    about = {"format": form, **played.settings(), **_origin(campaign, candidate)}
    levels = (
        f"at the generator: low level {played.low_V:g} V, high level {played.high_V:.6g} V, "
        f"one period of {played.volts.size / played.rate_MSps:.6g} µs ({about['frequency_Hz']:.6g} Hz)"
    )
    return DriveFile(content=content, about=about, notes=(*notes, levels))


def _check(
    campaign: Campaign, drive: Waveform, times_us: FloatArray, volts: FloatArray, settings: DriveSettings
) -> None:
    config = CampaignConfig.from_dict(campaign.config)
    check_delivered(config, drive, times_us, volts, most_cm_s=settings.max_error_cm_s)


def _warning(campaign: Campaign, candidate: int) -> str:
    """What a file says where its waveform leaves many switches open; else ""."""
    return choose(campaign.path, candidate).warning


def _origin(campaign: Campaign, candidate: int) -> dict[str, Any]:
    return {
        "candidate": candidate,
        "fingerprint": campaign.fingerprint,
        "warning": _warning(campaign, candidate),
    }


def _comments(campaign: Campaign, candidate: int, drive: Waveform) -> list[str]:
    lines = describe_waveform([list(row) for row in drive.rows()]).splitlines()
    name = cell(campaign.config["campaign"]["name"])  # one line: in a netlist a line of its own could be a command
    return [
        f"softclose waveform: candidate {candidate} of {name} ({campaign.fingerprint[:12]})",
        *filter(None, [_warning(campaign, candidate)]),
        *lines,
    ]
