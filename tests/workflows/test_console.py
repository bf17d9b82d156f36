"""Claims about tables at the terminal: nothing that names a row is cut at 80 columns, nothing is padded in a pipe."""

from __future__ import annotations

import io
import math
import os
import re
import sys

import pytest
from rich.console import Console
from rich.table import Table

from softclose_workflows import terminal
from softclose_workflows.tell import console as consoles
from softclose_workflows.tell import labels
from softclose_workflows.tell.console import wide_console
from softclose_workflows.tell.tables import difference_with_interval, points, share, with_interval


def table() -> Table:
    made = Table(title="Certified", caption="95 % intervals")
    made.add_column("design")
    made.add_column("waveform", min_width=20)
    for name in ("v_u [cm/s]", "g [cm/s]"):
        made.add_column(name, justify="right", no_wrap=True)
    made.add_row(
        "candidate 7170, incumbent", "84.95 V from 0.00 µs, rise 4.00 µs", "13.82 (13.75–13.89)", "14.49 (14.40–14.57)"
    )
    made.add_row("unshaped", "100.00 V from 0.00 µs", "40.10 (38.95–43.41)", "40.10 (38.95–43.61)")
    return made


def printed(monkeypatch: pytest.MonkeyPatch, width: int | None) -> list[str]:
    """What a terminal of that width, or a pipe, receives."""
    out = io.StringIO()
    monkeypatch.setattr("sys.stdout", out)
    monkeypatch.setattr(Console, "is_terminal", property(lambda self: width is not None))
    monkeypatch.setattr(Console, "width", property(lambda self: width or 160))
    wide_console().print(table())
    return re.sub(r"\x1b\[[0-9;]*m", "", out.getvalue()).splitlines()


def test_in_a_pipe_lines_end_where_their_text_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = printed(monkeypatch, None)
    assert all(line == line.rstrip() for line in lines)
    assert "candidate 7170, incumbent" in "\n".join(lines)
    assert any("13.82 (13.75–13.89)" in line and "candidate 7170" in line for line in lines)


def test_a_wide_terminal_gets_a_table(monkeypatch: pytest.MonkeyPatch) -> None:
    assert any("candidate 7170" in line and "14.49 (14.40–14.57)" in line for line in printed(monkeypatch, 160))


@pytest.mark.parametrize("width", [60, 90])
def test_a_narrow_terminal_gets_the_rows_one_below_the_other(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [line.rstrip() for line in printed(monkeypatch, width)]
    assert max(map(len, lines)) <= width
    at = lines.index("candidate 7170, incumbent")
    assert lines[at + 1].split(None, 1) == ["waveform", "84.95 V from 0.00 µs, rise 4.00 µs"]
    assert lines[at + 2].split(None, 2)[1:] == ["[cm/s]", "13.82 (13.75–13.89)"]
    assert lines.index("unshaped") > at + 3
    assert lines[-1] == "95 % intervals"


def test_other_things_are_printed_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    monkeypatch.setattr("sys.stdout", out)
    consoles.wide_console().print("best: candidate 3")
    assert out.getvalue() == "best: candidate 3\n"


def test_a_negative_number_has_a_minus_sign_everywhere_and_a_rounded_zero_has_none() -> None:
    assert with_interval(-8.954, -9.1, -8.7) == "−8.95 (−9.10 to −8.70)"
    assert with_interval(0.0001, -0.0001, 0.0004) == "0.0001 (−0.0001 to 0.0004)"
    assert with_interval(-0.001, -0.001, 3.0) == "0.00 (0.00–3.00)"
    assert points(-0.0069, -0.0083, -0.0054) == "−0.69 (−0.83 to −0.54)"
    assert difference_with_interval(0.5, -0.001, math.inf) == "+0.50 (+0.00 to +∞)"
    assert labels.signed(-0.001, 2) == "+0.00"
    assert labels.number(-0.001, 2) == "0.00"


def test_a_sentence_is_folded_between_words_at_a_terminal_and_whole_in_a_log(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = "  candidate 56 holds with 74.76 V, and one switch needs more: see runs/a-long-path-that-nothing-cuts.zarr"
    monkeypatch.setattr("shutil.get_terminal_size", lambda *_, **__: os.terminal_size((40, 24)))  # pytest asks too
    terminal.say(said)
    assert capsys.readouterr().out == f"{said}\n"
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    terminal.say(said)
    lines = capsys.readouterr().out.splitlines()
    assert " ".join(line.strip() for line in lines) == said.strip()
    assert all(line.startswith("  ") for line in lines)
    assert [line for line in lines if len(line) > 40] == ["  runs/a-long-path-that-nothing-cuts.zarr"]


def test_a_log_gets_a_sentence_and_a_cell_on_one_line_each(monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    monkeypatch.setattr("sys.stdout", out)
    sentence, cell, caption = (" ".join([word] * 60) for word in ("sentence", "cell", "caption"))
    wide_console().print(sentence)
    long = Table(title="title", caption=caption)
    long.add_column("design")
    long.add_row(cell)
    wide_console().print(long)
    lines = out.getvalue().splitlines()
    assert lines[0] == sentence
    assert any(cell in line for line in lines)
    assert lines[1] == "title"
    assert lines[-1] == caption


def test_a_figure_and_its_interval_have_the_same_digits() -> None:
    assert with_interval(21.29, 21.27, 21.32, 1) == "21.29 (21.27–21.32)"
    assert share(0.0, 0.0, 0.000038) == "0.000 % (0.000–0.004)"
    assert share(0.0348, 0.0337, 0.036) == "3.48 % (3.37–3.60)"


def test_what_nothing_bounds_is_infinite_in_one_way() -> None:
    assert with_interval(math.inf, 67.1, math.inf, 1) == "∞ (67.1–∞)"
    assert with_interval(math.inf, math.nan, math.nan) == "∞"
    assert with_interval(19.7, 19.21, 20.14) == "19.70 (19.21–20.14)"


@pytest.mark.parametrize("said", [terminal.READING, terminal.STARTING])
def test_a_spinner_fits_one_line_of_80_columns(said: str) -> None:
    """One that is folded leaves a line behind at every turn."""
    assert len(f"⠋ {said} …") < 80
