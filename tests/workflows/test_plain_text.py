"""Claims about text: what a file or a store names is printed and exported as text, whatever stands in it."""

from __future__ import annotations

import csv
import io
import os
import re
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from small_campaigns import COARSE, make_campaign
from softclose.population import PopulationError
from softclose.population.files import read_population
from softclose.settings import ConfigError, load_config
from softclose.switch.reduced_order import ReducedOrderError, read_reduced_order
from softclose_workflows.cli import main
from softclose_workflows.exports.tables import cell
from softclose_workflows.tell.console import stacked
from softclose_workflows.tell.standing import read_standing
from softclose_workflows.tell.tables import print_standing
from softclose_workflows.terminal import plain_console, visible

NASTY = "lot 7 [/old] [bold]x[/bold] :smile: \x1b]0;title\x07\x1b[2J\u202egnp.exe \x9b31m"


def _run(*arguments: object, code: int = 0, **options: str) -> str:
    done = CliRunner().invoke(main, [str(a) for a in arguments], env=options)
    assert done.exit_code == code, (done.output, done.exception)
    return done.output


@given(st.text())
def test_what_is_printed_controls_nothing_and_loses_nothing(text: str) -> None:
    shown = visible(text)
    assert re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]", shown) is None
    assert visible(shown) == shown
    if text.isprintable():
        assert shown == text


@given(st.text(max_size=40), st.booleans())
def test_a_console_takes_text_for_text(text: str, terminal: bool) -> None:
    for made in (
        text,
        Text(text),
        Panel(Text(text), title=Text(text)),
        _table(text),
        stacked(_table(text)),
    ):
        out = io.StringIO()
        plain_console(file=out, force_terminal=terminal, width=400).print(made)
        said = re.sub(r"\x1b\[[0-9;]*m", "", out.getvalue())
        assert re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]", said) is None


def _table(text: str) -> Table:
    table = Table(title=text, caption=text)
    table.add_column(text)
    table.add_column("b")
    table.add_row(text, text)
    return table


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    return make_campaign(tmp_path_factory.mktemp("named") / "a.zarr", *COARSE, f'campaign.name="{_toml(NASTY)}"')


def _toml(text: str) -> str:
    return "".join(c if c.isprintable() and c not in '"\\' else f"\\u{ord(c):04x}" for c in text)


@pytest.mark.parametrize(
    "arguments", [["status"], ["status", "--watch"], ["pareto"], ["certify", "--switches", "1000"], ["verify"]]
)
def test_a_name_is_text_in_every_command(store: str, arguments: list[str]) -> None:
    said = _run(arguments[0], store, *arguments[1:])
    assert "\x1b" not in said
    assert "\x07" not in said
    if arguments == ["status"]:
        assert "lot 7 [/old] [bold]x[/bold] :smile: \\x1b]0;title\\x1b[2J\\u202egnp.exe" in said


def test_an_error_is_text(tmp_path: Path) -> None:
    assert "\\x1b[2J" in _run("status", tmp_path / "a\x1b[2J.zarr", code=2)


@given(st.text(max_size=20))
def test_a_cell_of_a_csv_is_no_formula(text: str) -> None:
    out = io.StringIO()
    csv.writer(out).writerow([cell(text), cell(3.5)])
    (first, second), *more = csv.reader(io.StringIO(out.getvalue(), newline=""))
    assert not more
    assert first.strip()[:1] not in ("=", "+", "-", "@") or not first.strip()
    assert second == "3.5"
    if re.fullmatch(r"[A-Za-z][A-Za-z0-9 ,;\"']*", text):
        assert first == text


def test_device_names_of_a_table_are_no_formulas(tmp_path: Path) -> None:
    store = make_campaign(tmp_path / "t.zarr", *COARSE, "trim.measured=pull-in")
    devices = tmp_path / "d.csv"
    devices.write_text("device,pull_in_V\n=cmd|'/c calc'!A0,80\n@x,81\n")
    said = _run("export", store, "trim", "--devices", devices)
    assert "\n'=cmd|" in said
    assert "\n'@x," in said


DEEP = ["[" * 3000, "[" * 3000 + "]" * 3000, "{a=" * 2000, "9" * 4400, "1" * 400, "-" + "9" * 30]


@pytest.mark.parametrize("value", DEEP, ids=lambda v: f"{v[:3]}…{len(v)}")
def test_what_has_no_end_is_refused_in_files_and_settings(value: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"seed|integer|TOML"):
        load_config("current", [f"campaign.seed={value}"])
    file = tmp_path / "a.toml"
    file.write_text(f"[D]\nlower = {value}\n")
    for read, error in ((read_population, PopulationError), (read_reduced_order, ReducedOrderError)):
        with pytest.raises(error, match=r"not valid TOML|integer"):
            read(file)
    with pytest.raises(ConfigError, match=r"not valid TOML|integer"):
        load_config(file)


def test_a_byte_order_mark_is_no_part_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text('[campaign]\nname = "with a mark"\n', encoding="utf-8-sig")
    assert load_config(file).campaign.name == "with a mark"


def test_what_is_no_plain_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "large.toml").write_bytes(b"#" * (5 * 2**20))
    (tmp_path / "latin.toml").write_bytes('name = "geprüft"'.encode("latin-1"))
    for name, why in (("pipe", "not a plain file"), ("large", "MiB"), ("latin", "not UTF-8"), ("none", "no such file")):
        with pytest.raises(ConfigError, match=why):
            load_config(tmp_path / f"{name}.toml")
    for what in (None, 3):
        with pytest.raises(ReducedOrderError, match="is no file"):
            read_reduced_order(what)  # type: ignore[arg-type]


def test_the_home_folder_is_found_wherever_a_path_is_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a folder named ~ is made, and somebody removes it with rm -rf ~."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    monkeypatch.chdir(tmp_path)
    lot = tmp_path / "home" / "lot.toml"
    lot.write_text('base = "current"\nname = "at home"\n')
    assert load_config("current", ["population.name=~/lot.toml"]).build_population().name == "at home"
    (tmp_path / "mine.toml").write_text('[population]\nname = "~/lot.toml"\n')
    assert load_config("mine.toml").build_population().name == "at home"
    from softclose_store import open_campaign

    make_campaign("~/a.zarr", *COARSE)
    assert len(open_campaign("~/a.zarr").history()) > 0
    _run("export", "~/a.zarr", "waveform", "-o", "~/drive.csv")
    _run("export", "~/a.zarr", "waveform", "--output=~/drive2.csv")
    _run("tls", "~/tls")
    assert {p.name for p in (tmp_path / "home").iterdir()} == {"lot.toml", "a.zarr", "drive.csv", "drive2.csv", "tls"}
    assert {p.name for p in tmp_path.iterdir()} == {"home", "mine.toml"}


def test_keys_do_not_go_into_a_store_or_a_folder_of_others(store: str, tmp_path: Path) -> None:
    before = {p: p.stat().st_mode for p in Path(store).rglob("*")} | {Path(store): Path(store).stat().st_mode}
    for place in (store, f"{store}/records", f"{store}/tls"):
        assert f"softclose certify {store}" in _run("tls", place, code=2)
    assert {p: p.stat().st_mode for p in Path(store).rglob("*")} | {Path(store): Path(store).stat().st_mode} == before
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("")
    assert "not an empty folder" in _run("tls", tmp_path / "mine", code=2)
    assert "not an empty folder" in _run("tls", tmp_path / "mine" / "thesis.tex", code=2)
    (tmp_path / "new").mkdir()
    _run("tls", tmp_path / "new")
    assert "holds a key already" in _run("tls", tmp_path / "new", code=2)


def test_a_path_that_cannot_be_is_bad_input() -> None:
    for command in (["status"], ["run", "current", "--serial", "--store"]):
        assert "File name too long" in _run(*command, "x" * 300 + ".zarr", code=2)
        assert "is a URL of an archive; give the path of the file" in _run(*command, "zip://x", code=2)


def test_a_campaign_of_which_all_failed_says_how_it_is_tried_again(
    store: str, capsys: pytest.CaptureFixture[str]
) -> None:
    standing = read_standing(store)
    for failed, told in ((standing.committed, True), (standing.committed - 1, False)):
        print_standing(replace(standing, failed=failed, best=None, reason="no license"))
        assert ("--retry-failed" in capsys.readouterr().out) == told
