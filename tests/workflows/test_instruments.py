"""Claims about generator files: read by a small reader of its own, each is the waveform within its quantisation."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from softclose.waveform import Waveform
from softclose_store import open_campaign
from softclose_workflows.cli import main

GAIN = 20.0


def export(store: Path, target: Path, form: str, *arguments: str) -> Result:
    asked = ["export", str(store), "waveform", "--format", form, "-o", str(target), *arguments]
    return CliRunner().invoke(main, asked)


def read_keysight(content: bytes) -> tuple[np.ndarray, float]:
    """Volts and samples per second, by the header's own word."""
    head, data = content.decode("ascii").split("Data:\r\n")
    fields = dict(line.split(":", 1) for line in head.splitlines())
    assert (fields["File Format"], fields["Channel Count"], fields["Data Type"]) == ("1.10", "1", '"short"')
    codes = np.array([int(line) for line in data.splitlines()])
    assert codes.size == int(fields["Data Points"])
    assert np.abs(codes).max() <= 32767
    high, low = float(fields["High Level"]), float(fields["Low Level"])
    return 0.5 * (high + low) + codes / 32767 * 0.5 * (high - low), float(fields["Sample Rate"])


def read_tektronix(content: bytes) -> np.ndarray:
    """Codes from 0 to 1; checks that the preview encloses them."""
    magic, version, n, has_envelope = struct.unpack_from(">10s6x3I", content)
    assert (magic, version, has_envelope) == (b"TEKAFG3000", 20050114, 1)
    codes = np.array(struct.unpack_from(f">{n}H", content, 512))
    assert len(content) == 512 + 2 * n
    preview = np.frombuffer(content[28 : 28 + 412], dtype=np.uint8).reshape(206, 2)
    for (low, high), part in zip(preview, np.array_split(codes, 206), strict=True):
        assert (low, high) == (part.min() >> 6, part.max() >> 6)
    return codes / 16382


def read_siglent(content: bytes) -> tuple[np.ndarray, dict[str, float]]:
    """Volts and the header."""
    lines = content.decode("ascii").split("\r\n")
    header = {name: float(value) for name, value in (line.split(",") for line in lines[:5])}
    assert list(header) == ["data length", "frequency", "amp", "offset", "phase"]
    assert lines[5:13] == [""] * 7 + ["xpos,value"]
    rows = [line.split(",") for line in lines[13:-1]]
    assert [int(x) for x, _ in rows] == list(range(1, 16385))
    return np.array([float(v) for _, v in rows]), header


@pytest.fixture(params=["best", "first"])
def drive(request: pytest.FixtureRequest, finished_store: Path) -> tuple[Path, int, Waveform]:
    """A store, a candidate and its waveform."""
    campaign = open_campaign(finished_store)
    best = campaign.best()
    assert best is not None
    i = best.candidate if request.param == "best" else 0
    return finished_store, i, Waveform.from_rows(campaign.waveform(i))


def test_keysight_plays_the_waveform(drive: tuple[Path, int, Waveform], tmp_path: Path) -> None:
    store, i, waveform = drive
    target = tmp_path / "drive.arb"
    done = export(store, target, "keysight-arb", "--gain", "20", "--rate", "4", "--candidate", str(i))
    assert done.exit_code == 0, done.output
    volts, rate = read_keysight(target.read_bytes())
    assert rate == 4e6
    u = waveform.voltage(np.arange(volts.size) / 4.0)
    assert np.abs(GAIN * volts - u).max() <= u.max() / 65534 / 2 + 1e-6
    assert "at the generator: low level 0 V, high level" in done.stderr


def test_tektronix_plays_the_waveform(drive: tuple[Path, int, Waveform], tmp_path: Path) -> None:
    store, i, waveform = drive
    target = tmp_path / "drive.tfw"
    asked = ("--gain", "20", "--rate", "4", "--duration", "100", "--candidate", str(i))
    assert export(store, target, "tektronix-tfw", *asked).exit_code == 0
    about = json.loads((tmp_path / "drive.tfw.json").read_text())
    shape = read_tektronix(target.read_bytes())
    volts = about["low_level_V"] + shape * (about["high_level_V"] - about["low_level_V"])
    # One period of the frequency that is to be set is all samples.
    t_us = np.arange(shape.size) / shape.size / about["frequency_Hz"] * 1e6
    u = waveform.voltage(t_us)
    assert np.abs(GAIN * volts - u).max() <= u.max() / 16382 / 2 + 1e-9
    assert about["final_volts_at_the_switch"] == pytest.approx(float(waveform.voltage(100.0)))


def test_siglent_plays_the_waveform(drive: tuple[Path, int, Waveform], tmp_path: Path) -> None:
    store, i, waveform = drive
    target = tmp_path / "drive.csv"
    done = export(store, target, "siglent-csv", "--gain", "20", "--duration", "200", "--candidate", str(i))
    assert done.exit_code == 0, done.output
    volts, header = read_siglent(target.read_bytes())
    u = waveform.voltage(np.arange(16384) / 16384 / header["frequency"] * 1e6)
    assert np.abs(GAIN * volts - u).max() <= GAIN * 0.5e-6 + 1e-4  # the header's frequency has six decimals
    assert header["offset"] + 0.5 * header["amp"] == pytest.approx(volts.max(), abs=2e-6)
    assert header["offset"] - 0.5 * header["amp"] == pytest.approx(0.0, abs=2e-6)


@pytest.mark.parametrize(
    ("form", "arguments", "says"),
    [
        ("keysight-arb", (), "give --gain (1 where there is none)"),
        ("keysight-arb", ("--gain", "0"), "the gain is 0; it must be above 0"),
        ("keysight-arb", ("--gain", "1"), "give at most 20 V"),
        ("keysight-arb", ("--gain", "20", "--rate", "5000"), "takes 8 to 1,000,000"),
        ("keysight-arb", ("--gain", "20", "--rate", "2000"), "above the 1,000 MS/s of a 33600"),
        ("tektronix-tfw", ("--gain", "20", "--rate", "1000"), "takes 2 to 131,072"),
        ("tektronix-tfw", ("--gain", "20", "--bits", "14"), "--bits has no meaning for --format tektronix-tfw"),
        ("siglent-csv", ("--gain", "20", "--rate", "10"), "--rate has no meaning for --format siglent-csv"),
        ("csv", ("--bits", "14"), "--bits has no meaning for --format csv; it belongs to dac"),
        ("csv", ("--gain", "20"), "it belongs to keysight-arb, siglent-csv, tektronix-tfw"),
        ("pwl", ("--rate", "20"), "--rate has no meaning for --format pwl"),
        ("dac", ("--nodes", "a b"), "--nodes has no meaning for --format dac; it belongs to pwl"),
        ("dac", (), "give --full-scale (the campaign's limit is 150 V)"),
    ],
)
def test_what_a_file_cannot_hold_is_one_message_and_no_file(
    finished_store: Path, tmp_path: Path, form: str, arguments: tuple[str, ...], says: str
) -> None:
    done = export(finished_store, tmp_path / "out", form, *arguments)
    assert done.exit_code == 2
    assert says in done.stderr
    assert list(tmp_path.iterdir()) == []
