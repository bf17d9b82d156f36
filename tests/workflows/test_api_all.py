"""Claims about the Python interface as a whole: a function a command, figures where commands draw one, short looks,
and a notebook that runs."""

from __future__ import annotations

import html
import json
import math
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from small_campaigns import COARSE, make_campaign
from softclose import Assessment, Population, Pulse, Responses, Waveform, assess, load_population, simulate
from softclose_workflows import api
from softclose_workflows.analyses.certify import certify
from softclose_workflows.analyses.signing import SignError
from softclose_workflows.cli import COMMANDS, main
from softclose_workflows.errors import ExportError
from softclose_workflows.exports.formats import MEANT_FOR
from softclose_workflows.tell.outputs import OutputError

NOTEBOOK = Path(__file__).parents[2] / "docs" / "how-to" / "tour.ipynb"


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = make_campaign(tmp_path_factory.mktemp("api") / "a.zarr", *COARSE)
    certify(path, n_switches=200, top=2)
    return path


def test_every_command_has_a_function_of_its_name() -> None:
    commands = {name for group in COMMANDS.values() for name in group} - {"completion", "bench"}
    assert commands <= set(api.__all__)
    assert all(callable(getattr(api, name)) for name in commands)
    assert {"ask", "tell", "correct", "withdraw"} <= set(dir(api.Bench))
    assert sorted(set(api.__all__)) == sorted(api.__all__)


def test_answers_are_tables_with_a_short_look_and_plots(store: str, tmp_path: Path) -> None:
    asked = {
        "compare": api.compare([store, store]),
        "drift": api.drift(store, values=[0.01], n_switches=100),
        "pareto": api.pareto(store),
        "opening": api.opening(store, at_us=250.0, n_switches=100),
        "certify": api.certify(store, n_switches=200, top=2),
    }
    for name, result in asked.items():
        figure = result.plot()
        assert len(figure.axes) >= 1, name
        assert len(repr(result).splitlines()) < 20, name
        assert result._repr_html_().startswith("<table>")
        assert len(result.to_frame()) == len(result.rows) > 0
    for result in (api.sign(store), api.tails(store, [30.0], methods=["brute"], n_switches=500)):
        with pytest.raises(ValueError, match="there is no figure of this"):
            result.plot()


def test_the_numbers_are_those_of_the_commands(store: str, tmp_path: Path) -> None:
    sheet = api.sign(store, {"v_u": 1e3}, tmp_path / "a.html")
    assert (tmp_path / "a.html").exists()
    assert {row["quantity"]: row["verdict"] for row in sheet.rows}["v_u"] == sheet.value.lines[0].verdict == "pass"
    with pytest.raises(SignError):
        api.sign(store, {"nothing": 1.0})
    assert api.status(store).committed == 8
    assert api.verify(store).ok
    front = api.pareto(store)
    assert [row["candidate"] for row in front.rows] == [row["candidate"] for row in front.value["front"]]
    shipped = api.populations(["current"])
    assert shipped.value["current"] == dict(load_population("current").summary())
    drifted = api.drift(store, values=[0.01, -0.01], n_switches=100)
    assert [row["drift"] for row in drifted.rows] == sorted(row["drift"] for row in drifted.rows)


def test_exports_are_datasets_and_texts_and_files(store: str, tmp_path: Path) -> None:
    history = api.export(store, "history", tmp_path / "h.csv")
    assert not isinstance(history, str)
    assert history.sizes["candidate"] == 8
    assert len((tmp_path / "h.csv").read_text().splitlines()) == 9
    lot = api.export(store, "ensemble", candidate=3)
    assert not isinstance(lot, str)
    assert lot.sizes["switch"] == 80
    text = api.export(store, "waveform", tmp_path / "w.csv", rate_MSps=1.0)
    assert isinstance(text, str)
    assert (tmp_path / "w.csv").read_text() == text
    assert len(text.splitlines()) >= 251
    with pytest.raises(ExportError, match="nothing to export"):
        api.export(store, "drive")  # type: ignore[arg-type]


def test_every_format_of_a_drive_is_the_command_s(store: str, tmp_path: Path) -> None:
    settings: dict[str, dict[str, Any]] = {
        "csv": {"duration_us": 100.0, "max_error_cm_s": 50.0},
        "pwl": {"tolerance_mV": 5.0, "nodes": "a b"},
        "dac": {"full_scale_V": 200.0, "bits": 12, "signed": False},
        "keysight-arb": {"gain": 20.0, "rate_MSps": 4.0},
        "tektronix-tfw": {"gain": 20.0},
        "siglent-csv": {"gain": 20.0},
    }
    assert set(settings) == set(MEANT_FOR)
    typed = {"full_scale_V": "--full-scale", "duration_us": "--duration", "tolerance_mV": "--tolerance"}
    typed |= {"rate_MSps": "--rate", "max_error_cm_s": "--max-error"}
    for form, given in settings.items():
        mine, theirs = tmp_path / f"{form}.mine", tmp_path / f"{form}.theirs"
        content = api.export(store, "waveform", mine, format=form, **given)
        words = [
            word
            for name, value in given.items()
            for word in (["--unsigned"] if value is False else [typed.get(name, f"--{name}"), str(value)])
        ]
        asked = ["export", store, "waveform", "--format", form, "-o", str(theirs), *words]
        assert CliRunner().invoke(main, asked).exit_code == 0
        assert isinstance(content, str | bytes)
        written = content.encode() if isinstance(content, str) else content
        assert mine.read_bytes() == theirs.read_bytes() == written, form
        beside = [path.with_name(f"{path.name}.json") for path in (mine, theirs)]
        assert [path.exists() for path in beside] == [form not in ("csv", "pwl")] * 2
        assert not beside[0].exists() or beside[0].read_bytes() == beside[1].read_bytes()


def test_a_campaign_file_is_begun_as_by_the_command(tmp_path: Path) -> None:
    mine, theirs = tmp_path / "mine.toml", tmp_path / "theirs.toml"
    text = api.init(mine, n_pulses=3, max_volts=120.0)
    done = CliRunner().invoke(main, ["init", str(theirs), "--pulses", "3", "--max-volts", "120"])
    assert done.exit_code == 0, done.output
    assert mine.read_text("utf-8") == theirs.read_text("utf-8") == text == api.init(n_pulses=3, max_volts=120.0)
    with pytest.raises(OutputError, match="exists already"):
        api.init(mine)
    assert api.init(mine, force=True) != text


def test_settings_that_a_format_does_not_have_are_refused(store: str, tmp_path: Path) -> None:
    for what, settings, said in (
        ("waveform", {"format": "csv", "bits": 12}, "bits has no meaning for"),
        ("waveform", {"volume": 3}, "no setting volume"),
        ("waveform", {"format": "wav"}, "no format of a waveform"),
        ("waveform", {"format": "dac"}, "--full-scale"),
        ("history", {"gain": 20.0}, "history has no gain"),
    ):
        with pytest.raises(ExportError, match=said):
            api.export(store, what, tmp_path / "a", **settings)  # type: ignore[call-overload, arg-type]
    assert list(tmp_path.iterdir()) == []


def test_a_run_draws_every_figure_by_its_name(store: str) -> None:
    run = api.open_run(store)
    assert len(run.plot("convergence").axes) >= 1
    with pytest.raises(ValueError, match="there are response, pulses, histogram"):
        run.plot("nothing")


def looks() -> list[Any]:
    lot = load_population("current").sample(300, seed=3)
    drive = Waveform([Pulse(start_us=0.0, rise_us=4.0, peak_us=math.inf, volts=100.0)])
    response = simulate(lot, drive)
    return [drive, load_population("current"), response, assess(response)]


@pytest.mark.parametrize("thing", looks(), ids=lambda thing: type(thing).__name__)
def test_what_is_looked_at_is_short(thing: Waveform | Population | Responses | Assessment) -> None:
    text, page = repr(thing), thing._repr_html_()
    assert len(text.splitlines()) <= 6
    assert len(text) < 400
    assert type(thing).__name__ in text
    assert page.startswith("<table><caption>")
    assert page.count("<tr>") == page.count("</tr>") > 0


def test_a_waveform_s_look_makes_it_again() -> None:
    drive = Waveform.from_rows([[0.0, 4.15, 2.9, 139.23], [1.5, 0.0, math.inf, 80.71]])
    assert eval(repr(drive), {"Waveform": Waveform, "inf": math.inf}) == drive
    assert "ideal step, holds" in drive._repr_html_()


def test_strangers_names_stay_text() -> None:
    from softclose.glance import as_table

    hostile = "<script>alert(1)</script>"
    assert html.escape(hostile) in as_table(hostile, [(hostile, hostile)])
    assert "<script>" not in as_table(hostile, [(hostile, hostile)])


def notebook_cells() -> list[dict[str, Any]]:
    """Those with code, as they are committed."""
    return [c for c in json.loads(NOTEBOOK.read_text("utf-8"))["cells"] if c["cell_type"] == "code"]


@pytest.mark.long
@pytest.mark.slow
def test_the_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import matplotlib as mpl
    import matplotlib.pyplot as plt

    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for number, cell in enumerate(notebook_cells()):
        exec(compile("".join(cell["source"]), f"{NOTEBOOK.name}, cell {number}", "exec"), namespace)
    plt.close("all")


def test_the_notebook_was_run_from_its_begin_to_its_end() -> None:
    cells = notebook_cells()
    assert [c["execution_count"] for c in cells] == list(range(1, len(cells) + 1)), "run it before it is committed"
    kinds = [kind for c in cells for out in c["outputs"] for kind in out.get("data", {})]
    assert kinds.count("image/png") >= 3
    assert kinds.count("text/html") >= 4
    assert not [out for c in cells for out in c["outputs"] if out["output_type"] == "error"]
