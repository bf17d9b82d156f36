"""Claims about tables that people bring: every layout comes out as what was written, or is refused with its line."""

from __future__ import annotations

import csv
import io
import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from examples import examples
from softclose.datafiles import TableError, parsed_columns
from softclose.datafiles.decoding import decoded
from softclose.datafiles.headings import axis_units, candidates
from softclose.datafiles.numerals import STYLES, Style
from softclose.datafiles.units import FACTORS, LONGEST, has_other_unit, known_unit, name_and_unit
from softclose.population.measurements import MeasurementError, read_devices, read_measurements
from softclose.waveform import WaveformError, read_record

T_US = np.array([0.0, 0.5, 1.25, 2.0, 3.5, 9.0, 20.0, 45.5, 60.0, 131.0, 1043.0, 1044.5])
VOLTS = np.array([0.0, 4.856, 39.51, 89.1334, 131.9, 140.268915, 0.25, 12.0, 71.0, 71.0009, 70.5, 0.0])
HOW = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])

TIME_WORDS = {"s": ("s", "S", "sec", "seconds"), "ms": ("ms", "msec"), "us": ("us", "µs", "μs", "usec"), "ns": ("ns",)}
VOLT_WORDS = {"V": ("V", "volts", "Volt"), "mV": ("mV", "millivolts"), "kV": ("kV", "KV")}
IN_US = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}
IN_V = {"V": 1.0, "mV": 1e-3, "kV": 1e3}
FORMS = ("{0} ({1})", "{0} [{1}]", "{0}_{1}", "{0} / {1}", "{0} in {1}", "{0}({1})", "{1}")
PREAMBLES = (
    (),
    ("LECROYHDO4104,50000,Waveform", "Segments,1,SegmentSize,241", "#1,01-Jan-2024 12:00:00,0"),
    ("Model,MSO46", "Sample Interval,5e-07,", "Record Length,241,", "Probe Attenuation,10,", ""),
    (";Scopy version v1.4.1", ";Sample rate,2000000", ";Time base 5 ns"),
    ("# taken at 20 ns a sample, 3 mV of noise", "% 5 kV probe"),
    ("Sampling: 2 MS/s; 10 ms", "", "Trigger\t1.5\tV"),
)


@dataclass(frozen=True)
class Layout:
    """How a table is written."""

    encoding: str = "utf-8"
    ending: str = "\n"
    delimiter: str = ","
    decimal: str = "."
    thousands: str = ""
    quoted: bool = False
    digits: str = "g"
    time: str = "us"
    time_word: int = 0
    volt: str = "V"
    volt_word: int = 0
    form: str = FORMS[0]
    units_in: str = "heading"  # or a row below, the preamble, or nowhere
    order: tuple[str, ...] = ("time", "volts")
    trailing: bool = False
    preamble: tuple[str, ...] = ()
    blank: bool = False
    repeats: int = 0
    pairs: bool = False
    end: str = ""
    spoilt: str = ""


def number(value: float, layout: Layout) -> tuple[str, float]:
    """A number as the layout writes it, and the number that was written."""
    text = {"g": f"{value:.9g}", "fixed": f"{value:.9f}", "exp": f"{value:.9e}", "three": f"{value:.3f}"}[layout.digits]
    exact = float(text)
    whole, point, rest = text.partition(".")
    if layout.thousands and whole.lstrip("-").isdigit():
        sign, digits = ("-", whole[1:]) if whole.startswith("-") else ("", whole)
        whole = sign + f"{int(digits):,}".replace(",", layout.thousands)
    text = whole + (layout.decimal if point else "") + rest
    return f'"{text}"' if layout.quoted else text, exact


def written(layout: Layout) -> tuple[bytes, np.ndarray, np.ndarray]:
    """The file, and the instants [µs] and voltages [V] that it holds."""
    time_word = TIME_WORDS[layout.time][layout.time_word % len(TIME_WORDS[layout.time])]
    volt_word = VOLT_WORDS[layout.volt][layout.volt_word % len(VOLT_WORDS[layout.volt])]
    if layout.encoding in ("latin-1", "cp1252"):
        time_word = time_word.replace("μ", "µ")
    names = {"count": "Sample", "current": "I1 (mA)", "note": "Remark", "index": ""}
    units = {"count": "", "current": "", "note": "", "index": ""}
    for what, name, word in (("time", "Time", time_word), ("volts", "CH1", volt_word)):
        names[what] = layout.form.format(name, word) if layout.units_in == "heading" else name
        units[what] = f"({word})"
    heading = [layout.delimiter.join(names[c] for c in layout.order)]
    if layout.units_in == "row":
        heading.append(layout.delimiter.join(units[c] for c in layout.order))
    above = list(layout.preamble)
    if layout.units_in == "preamble":
        above += [f"Horizontal Units{layout.delimiter}{time_word}", f"Vertical Units{layout.delimiter}{volt_word}"]
    rows: list[str] = []
    t_us, volts = [], []
    for i, (t, u) in enumerate(zip(T_US / IN_US[layout.time], VOLTS / IN_V[layout.volt], strict=True)):
        for shift in (-0.25, 0.25) if layout.pairs else (0.0,):
            t_text, t_exact = number(t, layout)
            u_text, u_exact = number(u + shift / IN_V[layout.volt], layout)
            cells = {"time": t_text, "volts": u_text, "count": str(i), "index": str(len(rows)), "note": "ok"}
            cells["current"] = number(1.5 * i, layout)[0]
            rows.append(layout.delimiter.join(cells[c] for c in layout.order) + layout.delimiter * layout.trailing)
            t_us.append(t_exact * IN_US[layout.time])
            volts.append(u_exact * IN_V[layout.volt])
    _spoil(rows, layout)
    body: list[str] = []
    for i, row in enumerate(rows):
        body += heading if layout.repeats and i and i % layout.repeats == 0 else []
        body.append(row)
    lines = [*above, *heading, *([""] if layout.blank else []), *body, *([layout.end] if layout.end else []), ""]
    found_t, found_u = np.array(t_us), np.array(volts)
    if layout.pairs:
        found_t, found_u = found_t[::2], 0.5 * (found_u[::2] + found_u[1::2])
    return layout.ending.join(lines).encode(layout.encoding), found_t, found_u


def _spoil(rows: list[str], layout: Layout) -> None:
    if layout.spoilt == "cell":
        rows[7] = layout.delimiter.join(["∞" if c == "volts" else "3" for c in layout.order])
    elif layout.spoilt == "lost":
        rows[7] = layout.delimiter.join(["" if c == "volts" else "3" for c in layout.order])
    elif layout.spoilt == "order":
        rows[5], rows[7] = rows[7], rows[5]
    elif layout.spoilt == "words":
        rows.insert(7, "operator went home")
    elif layout.spoilt == "surplus":
        rows[7] += f"{layout.delimiter}17{layout.delimiter}4"
    elif layout.spoilt == "heading":
        rows.insert(7, layout.delimiter.join(f"{c} again" for c in layout.order))


def _distinct(layout: Layout) -> bool:
    """Whether no sign has two meanings."""
    if layout.decimal == layout.thousands:
        return False
    signs = {layout.decimal, layout.thousands}
    return layout.quoted or layout.delimiter.strip(" ") not in signs


def _clear(layout: Layout) -> bool:
    """Whether the file says everything once, so that it has to be read."""
    named = layout.form != "{1}" or layout.units_in != "heading"
    return (
        _distinct(layout)
        and not layout.thousands
        and layout.units_in in ("heading", "row")
        and not layout.spoilt
        and named
        and layout.delimiter != "   "
        and layout.digits != "three"
        and (layout.repeats == 0 or layout.units_in == "heading")
    )


LAYOUTS = st.builds(
    Layout,
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "latin-1", "cp1252"]),
    ending=st.sampled_from(["\n", "\r\n", "\r"]),
    delimiter=st.sampled_from([",", ";", "\t", "|", ", ", "   "]),
    decimal=st.sampled_from(".,"),
    thousands=st.sampled_from(["", "", "", ",", ".", "'", "’", " ", "\u00a0", "\u202f"]),
    quoted=st.booleans(),
    digits=st.sampled_from(["g", "fixed", "exp", "three"]),
    time=st.sampled_from(sorted(TIME_WORDS)),
    time_word=st.integers(0, 3),
    volt=st.sampled_from(sorted(VOLT_WORDS)),
    volt_word=st.integers(0, 3),
    form=st.sampled_from(FORMS),
    units_in=st.sampled_from(["heading", "heading", "row", "preamble", "nowhere"]),
    order=st.one_of(
        *map(
            st.permutations,
            (["time", "volts"], ["count", "time", "volts"], ["time", "current", "volts", "note"]),
        ),
        st.just(["index", "time", "volts"]),
    ).map(tuple),
    trailing=st.booleans(),
    preamble=st.sampled_from(PREAMBLES),
    blank=st.booleans(),
    repeats=st.sampled_from([0, 0, 5]),
    pairs=st.booleans(),
    end=st.sampled_from(["", "EOF", "\x1a", "End of data"]),
    spoilt=st.sampled_from(["", "", "", "cell", "lost", "order", "words", "surplus", "heading"]),
)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("brought") / "scope.csv"


@settings(HOW, max_examples=examples(400))
@given(layout=LAYOUTS)
@example(layout=Layout(decimal=",", thousands="."))
@example(layout=Layout(delimiter=";", decimal=",", thousands=".", time="ns", volt="mV"))
@example(layout=Layout(delimiter="\t", thousands=",", time="ns", volt="mV", digits="g"))
@example(layout=Layout(delimiter="   ", decimal=",", units_in="row"))
@example(layout=Layout(form="{1}", time="ms", preamble=PREAMBLES[1], spoilt="surplus"))
def test_a_drive_comes_out_as_it_was_written_or_is_refused_with_its_line(layout: Layout, file: Path) -> None:
    try:
        data, t_us, volts = written(layout)
    except UnicodeEncodeError:  # a sign that the encoding does not have
        return
    file.write_bytes(data)
    try:
        found = read_record(file).trace
    except WaveformError as e:
        assert not _clear(layout), (str(e), data.decode(layout.encoding))  # noqa: PT017
        assert re.match(r".*scope\.csv(, line \d+:|.* [Ll]ine \d+|: the samples span)", str(e)), str(e)  # noqa: PT017
        return
    assert layout.spoilt == "", data.decode(layout.encoding)
    np.testing.assert_allclose(found.times_us, t_us, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.volts, volts, rtol=1e-12, atol=1e-12)


@settings(HOW, max_examples=examples(150))
@given(layout=LAYOUTS)
def test_what_says_everything_is_read(layout: Layout, file: Path) -> None:
    """The same, of files that leave no doubt: a refusal of all would pass the claim above."""
    clear = replace(
        layout, thousands="", quoted=True, spoilt="", units_in="heading", form=layout.form.replace("{1}", "{0}_{1}")
        if layout.form == "{1}" else layout.form, digits="g" if layout.digits == "three" else layout.digits
    )  # fmt: skip
    clear = replace(clear, delimiter=";" if clear.delimiter == "   " else clear.delimiter)
    try:
        data, t_us, volts = written(clear)
    except UnicodeEncodeError:
        return
    file.write_bytes(data)
    found = read_record(file).trace
    np.testing.assert_allclose(found.times_us, t_us, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.volts, volts, rtol=1e-12, atol=1e-12)


DEVICES = {
    "G_um": [3.662, 3.7185, 3.641, 3.69, 3.755, 3.627, 3.701, 3.668, 3.812, 3.683],
    "D_um": [2.391, 2.455, 2.362, 2.488, 2.412, 2.437, 2.52, 2.379, 2.466, 2.402],
    "T_um": [6.61, 7.02, 6.92, 7.35, 6.48, 7.18, 6.75, 7.44, 6.33, 7.11],
    "pull_in_V": [74.0, 82.9, 80.1, 90.3, 74.8, 83.4, 79.6, 92.0, 71.5, 86.2],
}
LENGTHS = {"nm": 1e3, "um": 1.0, "mm": 1e-3, "µm": 1.0}


@settings(HOW, max_examples=examples(150))
@given(
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "latin-1"]),
    ending=st.sampled_from(["\n", "\r\n", "\r"]),
    delimiter=st.sampled_from([",", ";", "\t", "|"]),
    decimal=st.sampled_from(".,"),
    quoted=st.booleans(),
    digits=st.sampled_from(["r", ".3f", ".6f", ".2f"]),
    order=st.permutations(["device", *DEVICES, "Bemerkung"]),
    length=st.sampled_from(sorted(LENGTHS)),
    volts=st.sampled_from(["V", "mV", "kV"]),
    form=st.sampled_from(["{0}_{1}", "{0} ({1})", "{0} [{1}]", "{0}/{1}"]),
    case=st.sampled_from([str, str.lower, str.upper]),
    above=st.sampled_from([(), ("sep=%",), ("# lot 7, gap in nm", ""), ("Wafer 7; 12 devices",)]),
    twice=st.booleans(),
    repeats=st.booleans(),
)
def test_devices_come_out_as_they_were_written_or_are_refused(
    encoding: str, ending: str, delimiter: str, decimal: str, quoted: bool, digits: str, order: list[str], length: str,
    volts: str, form: str, case: type[str], above: tuple[str, ...], twice: bool, repeats: bool, file: Path,
) -> None:  # fmt: skip
    names = {"device": "device", "Bemerkung": "Bemerkung"}
    for name in DEVICES:
        quantity = name.rpartition("_")[0]
        names[name] = case(form.format(quantity, volts if name == "pull_in_V" else length))
    text = io.StringIO()
    quoting = csv.QUOTE_ALL if quoted else csv.QUOTE_MINIMAL
    writer = csv.writer(text, delimiter=delimiter, lineterminator=ending, quoting=quoting)  # type: ignore[arg-type]
    for line in above:
        text.write(line.replace("%", delimiter) + ending)
    expected: dict[str, list[float]] = {name: [] for name in DEVICES}
    writer.writerow([names[c] for c in order])
    for i in range(10):
        row = {"device": f"d{i}", "Bemerkung": "geprüft"}
        for name, values in DEVICES.items():
            factor = {"V": 1.0, "mV": 1e3, "kV": 1e-3}[volts] if name == "pull_in_V" else LENGTHS[length]
            plain = repr(values[i] * factor) if digits == "r" else format(values[i] * factor, digits)
            expected[name].append(float(plain) / factor)
            row[name] = plain.replace(".", decimal)
        for _ in range(2 if twice else 1):
            writer.writerow([row[c] for c in order])
        if repeats and i == 4:
            writer.writerow([names[c] for c in order])
    try:
        file.write_bytes(text.getvalue().encode(encoding))
    except UnicodeEncodeError:  # the capital of µ
        return
    try:
        found = read_measurements(file)
    except MeasurementError as e:
        doubtful = digits != "r" and digits != ".6f"  # rounded away, or three digits behind a sign
        shouted = case is not str and (volts != "V" or length in ("nm", "mm"))
        assert doubtful or shouted, (str(e), text.getvalue())  # noqa: PT017
        assert "scope.csv" in str(e)  # noqa: PT017
        return
    for name, values in expected.items():
        np.testing.assert_allclose(getattr(found, name), values, rtol=1e-9)
    assert found.device == tuple(f"d{i}" for i in range(10))
    assert any("several lines" in note for note in found.notes) == twice


@settings(HOW, max_examples=examples(400))
@given(data=st.one_of(st.binary(max_size=300), st.text(max_size=300).map(lambda s: s.encode("utf-8", "surrogatepass"))))
@example(data=b"")
@example(data=b"\xff\xfe")
@example(data=b"\xff\xfet")
@example(data=b"time_us,volts\n\x00,1\n")
@example(data=b"sep=")
@example(data=b'"time_us,volts\n0,0\n')
@example(data=b"time_us,volts\n" + b"9" * 140_000 + b",1\n")
@example(data=b"PK\x03\x04 a spreadsheet")
@example(data=b"time_us,volts\n0,1e999\n")
def test_any_bytes_are_read_or_refused(data: bytes, file: Path) -> None:
    """No other exception, whatever the file holds."""
    file.write_bytes(data)
    for read in (read_record, read_measurements):
        try:
            read(file)
        except (WaveformError, MeasurementError) as e:
            assert str(e).startswith(str(file))  # noqa: PT017


def _drive(file: Path, text: str, **said: object) -> tuple[list[float], list[float]]:
    file.write_text(text, encoding="utf-8")
    found = read_record(file, **said)  # type: ignore[arg-type]
    return found.trace.times_us.tolist(), found.trace.volts.tolist()


SAMPLES = "0,0\n5,80\n250,70\n"
EXPECTED = ([0.0, 5.0, 250.0], [0.0, 80.0, 70.0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,V(drive)\n0,0\n5e-6,80\n250e-6,70\n", {}),  # a SPICE program writes seconds
        ("x-axis,1\nsecond,Volt\n0,0\n5e-6,80\n250e-6,70\n", {}),
        ("X,CH1,Start,Increment,\nSequence,Volt,-5e-6,5e-6\n1,0,\n2,80,\n51,70,\n", {"time_unit": "s"}),
        ("Horizontal Units,s,,0,0\nVertical Units,V,,5e-6,80\n,,,250e-6,70\n", {}),
        ("Second,Value\n" + "0,0\n5e-6,80\n250e-6,70\n", {"volt_unit": "V"}),
        ("Vertical Units,CH1:V\nSecond,Value\n0,0\n5e-6,80\n250e-6,70\n", {}),
        ("t1,CH1,CH2\n0,9,0\n5,9,80\n250,9,70\n", {"columns": {"time_us": "t1", "volts_V": "CH2"}}),
        ("t1 (us),CH1,CH2 (mV)\n0,9,0\n5,9,80e3\n250,9,70e3\n", {"columns": {"volts": "ch2"}}),
        (SAMPLES, {"time_unit": "us", "volt_unit": "V"}),
        ("# time_us volts\n0 0\n5 80\n250 70\n", {}),
        ("% Model: switch.mph\n% t (s)   V1 (V)\n0   0\n5e-6   80\n250e-6   70\n", {}),
        (",time_us,volts\n0,0,0\n1,5,80\n2,250,70\n", {}),
        ("time_us,volts\n# a pause\n0,0\n5,80\n\n250,70\nEOF\n", {}),
    ],
)
def test_layouts_of_many_makers(text: str, said: dict[str, object], file: Path) -> None:
    t, u = _drive(file, text, **said)
    np.testing.assert_allclose(t, EXPECTED[0], atol=1e-9)
    np.testing.assert_allclose(u, EXPECTED[1], atol=1e-9)


MANY = "".join(f"{t},{50 + t % 7}\n" for t in range(240))


@pytest.mark.parametrize(
    ("text", "said", "why"),
    [
        ("Time,Ampl\n" + SAMPLES, {}, "line 1: nothing says the unit of the instants"),
        ("time_us,ch1\n" + SAMPLES, {}, "line 1: nothing says the unit of the voltages"),
        ("nr,time_s,ch1,ch2\n0,0,0,0\n1,1,2,3\n", {}, "'ch1', 'ch2' may each be the drive"),
        ("time_us,t2 (s),volts\n0,0,0\n5,5,80\n", {}, "may both be the instants"),
        ("Sample,CH1 (V)\n" + SAMPLES, {}, "'Sample' counts samples"),
        ("time_us,I (mA)\n" + SAMPLES, {}, "no column has voltages"),
        ("Time (ns),CH1 (V)\n0,0,0,0\n500,0,4,8\n", {}, "line 2: 4 fields, but the heading in line 1 names 2"),
        ("0,0,17\n5,80,17\n", {"time_unit": "us"}, "3 columns of numbers"),
        ("time_us,volts\n0,0\n5,∞\n9,80\n", {}, "line 3: volts is '∞': nothing was measured there, or the channel"),
        ("time_us,volts\n0,0\n5,\n9,80\n", {}, "line 3: volts is ''"),
        (
            "time_us;volts\n0;0\n5,5;80\n9.5;80\n",
            {},
            "numbers are written in two ways: '9.5' in line 4|'5,5' in line 3",
        ),
        ("time_us;volts\n0;0\n5;1,500\n9;2,500\n", {}, "can be read in two ways. Line 3: volts is 1.5 .* 1500 by"),
        ("time_us,volts\n" + MANY.replace("\n", "e-6\n").replace(",", "e-6,"), {}, "in which no switch moves"),
        ("time_s,volts\n" + MANY, {}, "span 2.39e.08 µs"),
        ("time_ms,volts\n" + MANY, {}, "are 1000 µs apart"),
        ("time_us,volts\n0,0\n5,80\n5,81\n9,80\n", {}, "line 4: the sample is at 5 µs, not after"),
        ("Horizontal Units,ms\ntime_us,volts\n" + SAMPLES, {}, "us by line 2 and ms by line 1"),
        ("Vertical Units,A\nTime (s),CH1\n" + SAMPLES, {}, "nothing says the unit of the voltages"),
        ("time_us,volts\n" + SAMPLES, {"time_unit": "s"}, "is us by line 1, not s; correct the file"),
        ("time_us,volts\n0,0\n1,1\ntime_us,CH2 (V)\n2,2\n", {}, "line 4: time is 'time_us'"),
        (
            "a,b\n" + SAMPLES,
            {"columns": {"time_us": "a", "volts_V": "c"}},
            "no columns are called 'c'; the heading has",
        ),
        ("time_us,volts\n0,0\n5,80\nMean,40\n", {}, "line 4: time is 'Mean'"),
        ("0,0\n5,80\ntime_us,volts\n9,9\n10,10\n", {}, "line [13]: "),
        ("time_us,volts\n", {}, "nothing stands below the heading|has no table"),
    ],
)
def test_what_is_not_certain_is_refused_by_line(text: str, said: dict[str, object], why: str, file: Path) -> None:
    with pytest.raises(WaveformError, match=why):
        _drive(file, text, **said)


def test_settings_that_are_none_are_refused(file: Path) -> None:
    text = "time_us,volts\n" + SAMPLES
    for said in (
        {"time_unit": "min"},
        {"volt_unit": "A"},
        {"columns": {"t": "a"}},
        {"scale": 0.0},
        {"scale": math.nan},
    ):
        with pytest.raises(WaveformError, match=r"must be|known are"):
            _drive(file, text, **said)
    for given_, why in (("a", "not of the form"), ("x=a", "known are"), ("time=a,time=b", "twice"), ("time=", "form")):
        with pytest.raises(TableError, match=why):
            parsed_columns(given_, ("time", "volts"))
    assert parsed_columns(" time = t 1 , volts=U=2", ("time", "volts")) == {"time": "t 1", "volts": "U=2"}
    assert parsed_columns(None, ("time",)) == {}


def test_what_is_no_plain_file_is_refused(tmp_path: Path) -> None:
    import os

    os.mkfifo(tmp_path / "pipe")  # reading it would never end
    for name, why in (
        ("pipe", "not a plain file"),
        (".", "not a plain file"),
        ("none", "no such file"),
        ("\0", "cannot"),
    ):
        with pytest.raises(WaveformError, match=why):
            read_record(f"{tmp_path}/{name}")


@pytest.mark.parametrize(
    ("heading", "rows", "why"),
    [
        ("gap;travel", "3,7;2,4", "no column 'G_um'"),
        ("G,D_um,T_um,pull_in_V", "3.7,2.4,7,80", "is 'G' meant. Then say --columns G_um=G"),
        ("G_um,G_nm,D_um,T_um,pull_in_V", "3.7,3700,2.4,7,80", "2 columns 'G_um'"),
        ("G_um,D_um,T_um,pull_in_V", "3.7,2.4,7,203", r"line 12: pull_in_V is 203, and the median of the lot 20"),
    ],
)
def test_tables_of_devices_are_refused_by_line(heading: str, rows: str, why: str, file: Path) -> None:
    usual = ["3.7,2.4,7,20"] * 10 if "203" in rows else []
    file.write_text("\n".join([heading, *usual, rows]), encoding="utf-8")
    with pytest.raises(MeasurementError, match=why):
        read_measurements(file)


def test_columns_are_named_by_the_user(file: Path) -> None:
    lines = [f"{i};{3600 + i};{2.4 + i / 100:.2f};{80 + i}".replace(".", ",") for i in range(9)]
    file.write_text("\n".join(["Nummer;gap [nm];travel;Vpi", *lines]), encoding="utf-8")
    theirs = {"G_um": "gap", "D_um": "travel", "pull_in_V": "vpi", "device": "nummer"}
    found = read_devices(file, ("G_um", "D_um", "pull_in_V"), columns=theirs)
    np.testing.assert_allclose(found.values["G_um"], 3.6 + np.arange(9) / 1000)
    np.testing.assert_allclose(found.values["D_um"], 2.4 + np.arange(9) / 100)
    assert found.names == tuple("012345678")
    with pytest.raises(MeasurementError, match="no quantity of a device is called 'gap'"):
        read_devices(file, ("G_um",), columns={"gap": "G_um"})
    with pytest.raises(MeasurementError, match="no column is called 'Gap2'"):
        read_devices(file, ("G_um",), columns={"G_um": "Gap2"})


def test_a_device_that_was_measured_twice_counts_once_and_two_of_one_name_are_refused(file: Path) -> None:
    rows = [f"d{i},{3.6 + i / 100},{2.4 + i / 100},{6 + i / 10},{75 + i}" for i in range(9)]
    again = [f"d{i},{3.604 + i / 100},{2.4 + i / 100},{6 + i / 10},{75 + i}" for i in range(9)]
    heading = "device,G_um,D_um,T_um,pull_in_V"
    file.write_text("\n".join([heading, *rows, *again]), encoding="utf-8")
    found = read_measurements(file)
    np.testing.assert_allclose(found.G_um, 3.602 + np.arange(9) / 100)
    assert "9 of 9 devices stand in several lines" in found.notes[0]
    other = [f"d{8 - i},{3.6 + i / 100},{2.4 + i / 100},{6 + i / 10},{75 + i}" for i in range(9)]
    file.write_text("\n".join([heading, *rows, *other]), encoding="utf-8")
    with pytest.raises(MeasurementError, match=r"line \d+: device 'd\d' stands in 2 lines, and its G_um differs"):
        read_measurements(file)


@given(st.floats(-1e12, 1e12), st.sampled_from(STYLES))
def test_a_number_is_itself_in_every_style(x: float, style: Style) -> None:
    text = f"{x:,.6f}" if style.thousands else f"{x:.6f}"
    text = text.translate({ord(","): style.thousands[:1], ord("."): style.decimal})
    assert style.value(text) == float(f"{x:.6f}")


@pytest.mark.parametrize(
    "text", ["", "-", "1e", "1 2", "0x1", "1_000", "٣", "∞", "nan", "1e999", "1,2.3,4", "1.2.3", "+-1"]
)
def test_what_is_no_number_is_none(text: str) -> None:
    assert [style.value(text) for style in STYLES] == [None] * len(STYLES)


def numbered(*lines: str, first: int = 1) -> list[tuple[int, tuple[str, ...]]]:
    """Lines of a file with their numbers, split at commas."""
    return [(first + i, tuple(line.split(","))) for i, line in enumerate(lines)]


def test_rows_of_different_length_have_the_columns_of_the_longest_and_a_comma_at_an_end_fills_none() -> None:
    (found,) = candidates(numbered("0,5,", "1,6,,", "2,7,,9"), [], {})
    assert (found.n_columns, found.numeric, found.filled) == (4, (0, 1), (0, 1, 3))
    (found,) = candidates(numbered("0,5", "1,6,"), [], {})
    assert (found.n_columns, found.numeric, found.filled) == (3, (0, 1), (0, 1))
    assert found.name(1) == "column 2"


def headings(*lines: str, commented: Sequence[str] = (), first: int = 1) -> list[tuple[int | None, int]]:
    """Where headings may stand, and the index of the first row below each; comments are above the lines."""
    return [(h.line, h.first) for h in candidates(numbered(*lines, first=first), numbered(*commented), {}) if h.line]


def test_a_line_of_one_word_is_no_heading() -> None:
    assert headings("Report", "t (s),U (V)", "0,5") == [(2, 2)]


def test_a_row_is_one_of_units_where_it_says_units_and_nothing_else() -> None:
    assert headings("t,U,n", "s,V,-", "0,5,1")[0] == (1, 2)
    for below in ("s,V,hello", "-,-,-", ",,,", "here,there,1"):
        assert (1, 2) not in headings("t,U,n", below, "0,5,1"), below


def test_a_heading_in_a_comment_is_the_last_one_above_the_samples() -> None:
    assert headings("0,5", "1,6", commented=["t (s),U (V)", "made,by hand"], first=3) == [(2, 0)]
    below = [*numbered("t (s),U (V)"), (9, ("the", "end"))]
    assert [h.line for h in candidates(numbered("0,5", "1,6", first=2), below, {})] == [None, 1]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"PK\x03\x04", "is a spreadsheet or a ZIP archive; save it as CSV"),
        (b"\xd0\xcf\x11\xe0", "is an old Excel file; save it as CSV"),
        (b"\x1f\x8b", "is compressed by gzip; unpack it"),
        (b"\x89HDF", "is an HDF5 file; export it as CSV"),
        (b"%PDF-1.7", "is a PDF"),
        (b"t,U\n\0\0\0\0", "is not text: it has zero bytes"),
    ],
)
def test_what_is_no_text_is_said_with_what_to_do(data: bytes, said: str, tmp_path: Path) -> None:
    file = tmp_path / "record"
    file.write_bytes(data)
    with pytest.raises(TableError, match=f"^{re.escape(str(file))} {said}$"):
        decoded(file)


def test_a_file_that_is_none_is_said_once(tmp_path: Path) -> None:
    for path, said in ((tmp_path, "it is not a plain file"), (tmp_path / "none.csv", "no such file")):
        with pytest.raises(TableError, match=f"^{re.escape(str(path))} cannot be read: {said}$"):
            decoded(path)


@pytest.mark.parametrize(
    ("data", "encoding", "text"),
    [
        ("µs €".encode(), "utf-8", "µs €"),
        (b"\xb5s \x80", "cp1252", "µs €"),
        (b"\xb5s \x81", "latin-1", "µs \x81"),
        ("t,U".encode("utf-16-be"), "utf-16-be", "t,U"),
    ],
)
def test_the_first_encoding_that_fits_counts(data: bytes, encoding: str, text: str, tmp_path: Path) -> None:
    file = tmp_path / "record.csv"
    file.write_bytes(data)
    found = decoded(file)
    assert (found.encoding, found.lines) == (encoding, (text,))


@pytest.mark.parametrize(
    "text",
    [
        "time_us;volts_V\n0;0\n999;80\n1,000;70\n",  # 1 after 999 would go back in time
        "sep=;\ntime_us;volts_V\n0;0\n999;80\n1000;70\n",  # a spreadsheet's own first line
        "time_us;volts_V\n0;0\n999;80\n1000;70\n",
    ],
)
def test_of_two_ways_to_read_a_record_the_one_counts_in_which_time_goes_on(text: str, tmp_path: Path) -> None:
    file = tmp_path / "record.csv"
    file.write_text(text, encoding="utf-8")
    trace = read_record(file).trace
    np.testing.assert_array_equal(trace.times_us, [0.0, 999.0, 1000.0])
    np.testing.assert_array_equal(trace.volts, [0.0, 80.0, 70.0])


def test_units_of_an_axis_are_those_of_all_of_its_channels() -> None:
    assert axis_units(["Horizontal Units,s", "Vertical Units,CH1:V,CH2:V"]) == {
        "horizontal": (1, "s"),
        "vertical": (2, "V"),
    }
    for line in ("Vertical Units,CH1:V,CH2:mV", "Vertical Units,dB", "Vertical Units,3"):
        assert axis_units([line]) == {}, line


def test_how_numbers_are_written_is_said_in_words() -> None:
    said = [str(style) for style in STYLES]
    assert said[:3] == ["decimal points", "decimal commas", "decimal points, commas between thousands"]
    assert len({*said}) == len(STYLES)


def test_every_unit_is_as_large_as_its_prefix_says() -> None:
    """By the SI, from the letters of each unit: in µs, V, µm, kHz and N/m."""
    prefixes = {"p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6}
    bases = {"time": "s", "voltage": "V", "length": "m", "frequency": "Hz", "stiffness": "N/m"}
    ours = {"time": 1e-6, "voltage": 1.0, "length": 1e-6, "frequency": 1e3, "stiffness": 1.0}
    for unit, (kind, factor) in FACTORS.items():
        size = 1.0 / 1e-3 if unit == "N/mm" else prefixes[unit.removesuffix(bases[kind])]
        assert factor == pytest.approx(size / ours[kind], rel=1e-12), unit
    assert {kind for kind, _ in FACTORS.values()} == {*bases}


def test_a_column_of_another_quantity_is_neither_time_nor_volts() -> None:
    for heading in ("I (A)", "I [mA]", "Level (dBm)", "I in A", "in A", "I/mA", "T (°C)"):
        assert has_other_unit(heading), heading
    for heading in ("CH1 (V)", "t [µs]", "channel A", "trace_A", "A", "ratio"):
        assert not has_other_unit(heading), heading


def test_headings_are_searched_for_a_unit_up_to_one_length() -> None:
    for unit, finds in (("V", lambda heading: name_and_unit(heading)[1] == "V"), ("A", has_other_unit)):
        longest = f"{'x' * (LONGEST - len(unit) - 2)}({unit})"
        assert len(longest) == LONGEST
        assert finds(longest)
        assert not finds(f"x{longest}")


def test_units_are_read_from_headings() -> None:
    for (unit, words), form in itertools.product({**TIME_WORDS, **VOLT_WORDS}.items(), FORMS[:-1]):
        for word in words:
            assert name_and_unit(form.format("CH1", word)) == ("CH1", unit), form.format("CH1", word)
    for heading in ("Channel A", "V(drive)", "Time", "CH1 (MV)", "Strom (A)", "temperature", "Time (min)", "x-axis"):
        assert name_and_unit(heading) == (heading, None)
    assert name_and_unit("in s") == ("", "s")
    assert known_unit("n/a") is None


BROUGHT = Path(__file__).parent / "brought"
"""One drive as instruments, simulators and spreadsheets write it: the instants and voltages of truth.csv."""

SAID: dict[str, dict[str, object]] = {
    "hantek.csv": {"columns": {"volts_V": "ch1"}, "time_unit": "s"},
    "lecroy.csv": {"time_unit": "s", "volt_unit": "V"},
    "lecroy_latin1.csv": {"time_unit": "s", "volt_unit": "V"},
    "rigol_ds1000z.csv": {"time_unit": "s"},
    "wrdata.txt": {"time_unit": "s", "volt_unit": "V"},
    "monitor_us_mV.csv": {"scale": 1000.0},
}
"""What the user has to say of a file that does not say it."""
REFUSED = {
    "comma_comma.csv": "line 2: 4 fields, but the heading in line 1 names 2 columns",
    "pico_overrange.csv": "line 16: volts is '∞': nothing was measured there, or the channel was overdriven",
    "unsorted.csv": r"line \d+: the sample is at .* µs, not after the one before it",
    "hantek.csv": "line 1: 'ch1', 'ch2' may each be the drive; say which one: --columns volts=ch1",
    "lecroy.csv": "line 5: nothing says the unit of the instants .* give --time-unit",
    "lecroy_latin1.csv": "line 5: nothing says the unit of the instants .* give --time-unit",
    "rigol_ds1000z.csv": "line 1: nothing says the unit of the instants .* give --time-unit",
    "wrdata.txt": "line 1: nothing says the unit of the instants .* give --time-unit",
}
COARSE = {"rigol_ds1000z.csv": 0.51, "hantek.csv": 0.006}
"""Volts to which a file rounds; the others give four digits behind the point, or six digits."""


def _samples(name: str, **said: object) -> dict[float, float]:
    trace = read_record(BROUGHT / name, **said).trace  # type: ignore[arg-type]
    return dict(zip(np.round(trace.times_us, 6).tolist(), trace.volts.tolist(), strict=True))


@pytest.mark.parametrize("name", sorted(file.name for file in BROUGHT.iterdir()))
def test_what_instruments_write_is_one_drive_or_is_refused(name: str) -> None:
    if name in REFUSED:
        with pytest.raises(WaveformError, match=re.escape(name) + ", " + REFUSED[name]):
            _samples(name)
    if name in REFUSED.keys() - SAID.keys():
        return
    truth, found = _samples("truth.csv"), _samples(name, **SAID.get(name, {}))
    assert found.keys() == truth.keys()
    for t, u in truth.items():
        assert found[t] == pytest.approx(u, abs=COARSE.get(name, 6e-4))
