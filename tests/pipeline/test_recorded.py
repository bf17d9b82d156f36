"""Claims about recorded drives: what is averaged, what is told of a file, which spans and columns are believed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from softclose.waveform import WaveformError
from softclose.waveform.recorded import Record, read_record

SAMPLES = "0,0\n5,80\n250,70\n"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "drive.csv"


def read(file: Path, text: str, **said: object) -> Record:
    file.write_text(text, "utf-8")
    return read_record(file, **said)  # type: ignore[arg-type]


def test_what_was_read_is_told(file: Path) -> None:
    first, *_ = read(file, "t (us),CH1 (mV)\n0,0\n5,80e3\n250,-70e3\n").notes
    assert first.endswith("3 samples from 0 to 250 µs, -70 to 80 V")
    assert "instants [us] from 't (us)'" in " ".join(read(file, "t (us),CH1 (mV)\n" + SAMPLES).notes)
    assert "voltages [mV] from 'CH1 (mV)'" in " ".join(read(file, "t (us),CH1 (mV)\n" + SAMPLES).notes)
    scaled = read(file, "time_us,volts\n" + SAMPLES, scale=-2.0)
    assert "-160 to 0 V (scaled by -2)" in scaled.notes[0]
    bare = read(file, SAMPLES, time_unit="us", volt_unit="V")
    assert "no heading: instants [us] from column 1, voltages [V] from 2" in " ".join(bare.notes)


def test_of_a_lowest_and_a_highest_sample_at_every_instant_the_mean_counts(file: Path) -> None:
    found = read(file, "time_us,volts\n0,0\n0,2\n5,78\n5,82\n250,70\n250,70\n")
    assert found.trace.times_us.tolist() == [0.0, 5.0, 250.0]
    assert found.trace.volts.tolist() == [1.0, 80.0, 70.0]
    assert "each of the 3 instants has two samples, the lowest and the highest: their mean is used" in found.notes
    assert len(read(file, "time_us,volts\n0,0\n0,2\n5,78\n5,82\n").trace.times_us) == 2
    for odd in ("0,0\n0,2\n5,78\n5,82\n9,70\n", "0,0\n0,2\n0,3\n0,4\n", "0,0\n0,2\n5,78\n6,82\n", "0,0\n0,1\n"):
        with pytest.raises(WaveformError, match="not after the one before it"):
            read(file, "time_us,volts\n" + odd)


def rows(n: int, apart_us: float) -> str:
    return "time_us,volts\n" + "".join(f"{k * apart_us:g},{50 + k % 7}\n" for k in range(n))


def test_a_span_that_no_record_of_a_switch_has_is_another_unit(file: Path) -> None:
    for n, apart in ((3, 4e5), (20, 49.0), (19, 60.0), (2, 1.0)):
        assert len(read(file, rows(n, apart)).trace.times_us) == n
    for n, apart, why in (
        (3, 6e5, "samples span 1.2e.06 µs and are 600000 µs apart"),
        (20, 60.0, "samples span 1140 µs and are 60 µs apart"),
        (3, 1e-4, "span 0.0002 µs, in which no switch moves"),
    ):
        with pytest.raises(WaveformError, match=why):
            read(file, rows(n, apart))


def test_an_instant_that_goes_back_is_told_with_its_line(file: Path) -> None:
    with pytest.raises(WaveformError, match=r"line 5: the sample is at 8 µs, not after the one before it at 9 µs"):
        read(file, "time_us,volts\n0,0\n5,1\n9,2\n8,3\n7,4\n")


def test_what_is_no_drive_is_told_with_file_and_line(file: Path) -> None:
    for rows, why in (
        ("0,0\n0,1\n5,2\n5,3\n5,4\n5,5\n", "line 3: the sample is at 0 µs, not after the one before it at 0 µs"),
        ("3,0\n5,1\n", "line 2: the first sample is at 3 µs"),
        ("0,0\n", "line 2: .*two samples or more"),
    ):
        with pytest.raises(WaveformError, match=r"drive\.csv, " + why):
            read(file, "time_us,volts\n" + rows)


def test_a_shift_and_a_scale_make_the_drive_but_not_the_table(file: Path) -> None:
    found = read(file, "time_us,volts\n-5,0\n5,80\n250,70\n", shift_us=5.0, scale=0.5)
    np.testing.assert_allclose(found.trace.times_us, [0.0, 10.0, 255.0])
    np.testing.assert_allclose(found.trace.volts, [0.0, 40.0, 35.0])
    assert found.table.numbers["time"].tolist() == [-5.0, 5.0, 250.0]
    assert found.table.numbers["volts"].tolist() == [0.0, 80.0, 70.0]


@pytest.mark.parametrize(
    ("heading", "time", "volts"),
    [
        ("nr,time_us,volts", 1, 2),
        ("volts,time_us,nr", 1, 0),
        ("index,t (us),u (V)", 1, 2),
        ("u (V),i (mA),t (us)", 2, 0),
        ("time (us),current (mA),drive (V)", 0, 2),
        ("nr,zeit (us),Spannung (V)", 1, 2),
    ],
)
def test_columns_are_found_by_their_units_and_names(heading: str, time: int, volts: int, file: Path) -> None:
    values = [[3.0, 4.0, 6.0], [3.0, 4.0, 6.0], [3.0, 4.0, 6.0]]
    values[time], values[volts] = [0.0, 5.0, 250.0], [1.0, 80.0, 70.0]
    text = heading + "\n" + "".join(",".join(f"{column[k]:g}" for column in values) + "\n" for k in range(3))
    found = read(file, text).trace
    assert found.times_us.tolist() == [0.0, 5.0, 250.0]
    assert found.volts.tolist() == [1.0, 80.0, 70.0]


@pytest.mark.parametrize(
    ("text", "said", "why"),
    [
        ("time_us,volts\n" + SAMPLES, {"columns": {"time_us": "time_us", "time": "volts"}}, "names time twice"),
        ("t,u,t\n0,0,0\n5,8,5\n9,9,9\n", {"columns": {"time_us": "t", "volts_V": "u"}}, "2 columns are called 't'"),
        ("nr,CH1\n" + SAMPLES, {}, "no heading above the samples names a column of instants"),
        ("time_us,I (A)\n" + SAMPLES, {}, r"no column has voltages; name it: --columns volts_V=NAME"),
        ("time_us,a (V),b (V)\n0,0,0\n5,8,5\n9,9,9\n", {}, r"may each be the drive; say which one: .*volts=a"),
        ("Horizontal Units,V\ntime,volts_V\n" + SAMPLES, {}, "the horizontal unit is V, which is none of time"),
        ("time_us,CH1\n" + SAMPLES, {}, r"write it in the heading \(volts_V\), or give --volt-unit \(V, mV"),
        ("t,volts_V\n" + SAMPLES, {}, r"write it in the heading \(time_s\), or give --time-unit \(s, ms"),
        ("time_us,volts_V\n" + SAMPLES, {"time_unit": "ns"}, "--columns time_ns=time_us"),
    ],
)
def test_what_is_refused_says_what_to_write(text: str, said: dict[str, object], why: str, file: Path) -> None:
    with pytest.raises(WaveformError, match=why):
        read(file, text, **said)


def test_what_a_heading_says_and_the_user_says_too_is_believed(file: Path) -> None:
    assert read(file, "time_us,volts_V\n" + SAMPLES, time_unit="us", volt_unit="V").trace.volts.max() == 80.0
    assert read(file, "time_us,volts_V\n" + SAMPLES, columns={"volts_mV": "volts_V"}).trace.volts.max() == 0.08
