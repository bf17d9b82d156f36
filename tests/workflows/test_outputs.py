"""Claims about where a command writes: a place that cannot be is one message, before any work, and nothing is left."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from reported import empty_store
from softclose_workflows.cli import main
from softclose_workflows.tell.outputs import (
    OutputError,
    check_file,
    default_name,
    make_folder,
    say_written,
    whole_file,
    write_text,
)

INTO_FILE = [
    ("report", "{store}", "-o", "{}"),
    ("compare", "{store}", "{store}", "-o", "{}"),
    ("calibrate", "{csv}", "-o", "{}"),
    ("calibrate", "{csv}", "-o", "{toml}", "--figure", "{}"),
    ("compare-engines", "current", "--engines", "sobol", "--figure", "{}"),
    ("export", "{store}", "history", "-o", "{}"),
    ("export", "{store}", "ensemble", "--format", "netcdf", "-o", "{}"),
    ("export", "{store}", "waveform", "-o", "{}"),
    ("export", "{store}", "waveform", "--format", "dac", "-o", "{}"),
    ("export", "{store}", "waveform", "--format", "pwl", "-o", "{}"),
]
INTO_FOLDER = [
    ("figures", "{store}", "-o", "{}"),
    ("reproduce", "--out", "{}"),
    ("study", "c1", "--out", "{}"),
]


def asked(arguments: tuple[str, ...], place: Path, folder: Path, store: Path) -> Result:
    csv = folder / "devices.csv"
    csv.write_text("G_um,D_um,T_um,pull_in_V\n")
    names = {"store": store, "csv": csv, "toml": folder / "out.toml"}
    return CliRunner().invoke(main, [a.format(place, **names) for a in arguments])


@pytest.fixture(scope="module")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign without one candidate: whatever looked at the store first would say so."""
    return Path(empty_store(tmp_path_factory.mktemp("empty")))


def refused(done: Result, word: str) -> None:
    assert done.exit_code == 2, (done.output, done.exception)
    assert len(done.output.splitlines()) == 1, done.output
    assert word in done.output


@pytest.mark.parametrize("arguments", INTO_FILE, ids=" ".join)
def test_a_folder_is_no_file(tmp_path: Path, empty: Path, arguments: tuple[str, ...]) -> None:
    there = tmp_path / "folder"
    there.mkdir()
    refused(asked(arguments, there, tmp_path, empty), "is a folder")
    missing = tmp_path / "none" / "a.svg"
    if arguments[:3] != ("calibrate", "{csv}", "-o") or "--figure" in arguments:
        refused(asked(arguments, missing, tmp_path, empty), "is no folder")
    assert list(there.iterdir()) == []
    assert not missing.parent.exists()


@pytest.mark.parametrize("arguments", INTO_FOLDER, ids=" ".join)
def test_a_file_is_no_folder(tmp_path: Path, empty: Path, arguments: tuple[str, ...]) -> None:
    there = tmp_path / "file"
    there.write_text("mine")
    refused(asked(arguments, there, tmp_path, empty), "is a file")
    refused(asked(arguments, there / "below", tmp_path, empty), "is a file")
    assert there.read_text() == "mine"


@pytest.mark.parametrize("arguments", [*INTO_FILE[2:5], *INTO_FOLDER[1:]], ids=" ".join)
def test_what_takes_long_looks_first_whether_it_may_write(
    tmp_path: Path,
    empty: Path,
    arguments: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: not str(path).startswith(str(tmp_path)))
    place = tmp_path / ("a.toml" if arguments[-2] == "-o" else "a.svg" if arguments[-2] == "--figure" else "new")
    refused(asked(arguments, place, tmp_path, empty), "may not be written")
    assert [p.name for p in tmp_path.iterdir()] == ["devices.csv"]


@pytest.mark.parametrize("arguments", [INTO_FILE[1], INTO_FILE[3], INTO_FILE[4]], ids=" ".join)
def test_a_figure_of_a_form_that_nobody_draws_is_refused(
    tmp_path: Path, empty: Path, arguments: tuple[str, ...]
) -> None:
    refused(asked(arguments, tmp_path / "a.docx", tmp_path, empty), ".svg")
    assert not (tmp_path / "a.docx").exists()


def test_a_file_appears_whole_or_the_old_one_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")

    def fail() -> None:
        with whole_file(path) as partial:
            partial.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_place_that_fails_only_when_it_is_written_is_one_message_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OutputError, match=r"No space left.*\(-o\)"):
        write_text(tmp_path / "a.txt", "new")
    monkeypatch.setattr(Path, "mkdir", full)
    with pytest.raises(OutputError, match=r"No space left.*\(--out\)"):
        make_folder(tmp_path / "new")
    assert list(tmp_path.iterdir()) == []


def test_an_ending_counts_in_either_case(tmp_path: Path) -> None:
    assert check_file(tmp_path / "A.SVG", "-o", [".svg"]) == tmp_path / "A.SVG"


@pytest.mark.parametrize(
    ("store", "name"),
    [
        ("runs/a.zarr", "a.html"),
        ("s3://bucket/night.zarr/", "night.html"),
        ("plain", "plain.html"),
        (".zarr", "campaign.html"),
        ("/", "campaign.html"),
    ],
)
def test_an_output_without_a_name_is_called_after_its_store(store: str, name: str) -> None:
    assert default_name(store, ".html") == name


def test_a_folder_is_made_with_all_above_it_and_may_be_there(tmp_path: Path) -> None:
    wanted = tmp_path / "a" / "b"
    assert make_folder(wanted) == wanted
    assert make_folder(wanted).is_dir()


def test_what_was_written_is_said_with_its_size(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sizes = {"small": 1_499, "largest-small": 100_000, "large": 100_001, "larger": 7_140_000}
    for name, size in sizes.items():
        (tmp_path / name).write_bytes(bytes(size))
    say_written([str(tmp_path / name) for name in sizes])
    told = [line.partition(f"{tmp_path}/")[2] for line in capsys.readouterr().out.splitlines()]
    assert told == ["small (1.5 kB)", "largest-small (100 kB)", "large (0.1 MB)", "larger (7.1 MB)"]
