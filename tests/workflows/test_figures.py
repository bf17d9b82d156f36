"""Claims about `softclose figures`: every figure in every format, the same bytes twice, readable by other programs."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from reported import empty_store
from softclose.waveform import Waveform
from softclose_workflows.cli import main
from softclose_workflows.commands.figures import NAMES
from softclose_workflows.figures.drawing import FIGURES
from softclose_workflows.figures.pulse import draw_pulses
from softclose_workflows.figures.saving import FORMATS
from softclose_workflows.figures.style import RC
from softclose_workflows.figures.writing import write_figures
from softclose_workflows.report.data import ReportData
from softclose_workflows.report.gather import gather


@pytest.fixture(scope="module")
def data(finished_store: Path) -> ReportData:
    return gather(str(finished_store), picks=False)


def test_the_command_offers_exactly_the_figures_that_exist() -> None:
    assert tuple(FIGURES) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_every_figure_has_labelled_axes_with_data(data: ReportData, name: str) -> None:
    with matplotlib.rc_context(RC):
        figure = FIGURES[name](data)
        assert figure is not None
        shown = [axes for axes in figure.axes if axes.get_visible() and axes.get_label() != "<colorbar>"]
        for axes in shown:
            assert axes.has_data()
            shared = axes.get_shared_x_axes().get_siblings(axes)
            assert any(other.get_xlabel() for other in shared)
            assert any(other.get_ylabel() for other in axes.get_shared_y_axes().get_siblings(axes))


def test_files_of_all_formats_are_what_they_say(data: ReportData, tmp_path: Path) -> None:
    paths = [Path(p) for p in write_figures(data, str(tmp_path), FORMATS, ["densities", "convergence"])]
    assert {p.name for p in paths} == {f"{n}.{f}" for n in ("densities", "convergence") for f in FORMATS}
    with Image.open(tmp_path / "densities.png") as image:
        assert image.info["dpi"] == pytest.approx((300, 300), abs=0.1)
        assert image.width == pytest.approx(1050, abs=2)
    assert ElementTree.parse(tmp_path / "densities.svg").getroot().tag.endswith("svg")
    pdf = (tmp_path / "densities.pdf").read_bytes()
    assert pdf.startswith(b"%PDF")
    assert b"/Type3" not in pdf


def test_the_same_store_gives_the_same_bytes(data: ReportData, tmp_path: Path) -> None:
    for folder in ("a", "b"):
        list(write_figures(data, str(tmp_path / folder), FORMATS, ["histogram"]))
    for kind in FORMATS:
        name = f"histogram.{kind}"
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), kind


def test_command_writes_only_what_was_asked_for(finished_store: Path, tmp_path: Path) -> None:
    arguments = ["figures", str(finished_store), "-o", str(tmp_path / "new"), "--only", "population", "--format", "svg"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["population.svg"]
    assert "population.svg" in result.output


def test_an_empty_store_has_figures_of_its_population_alone(tmp_path: Path) -> None:
    data = gather(empty_store(tmp_path))
    drawn = [Path(p).stem for p in write_figures(data, str(tmp_path / "figures"), ["svg"])]
    assert drawn == ["population"]


def test_a_folder_that_cannot_be_made_is_one_message(finished_store: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    arguments = ["figures", str(finished_store), "-o", str(tmp_path / "file"), "--only", "population"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert "-o" in result.output


def test_the_pulses_figure_names_the_four_numbers_of_each_pulse_and_draws_their_sum() -> None:
    drive = Waveform.from_rows([[0.0, 4.15, 2.9, 139.23], [8.0, 29.75, math.inf, 80.71]])
    figure = draw_pulses(drive, 250.0)
    first, second, whole = figure.axes
    said = [[text.get_text() for text in axes.texts if text.get_text()] for axes in (first, second)]
    assert said[0] == ["rise 4.15 µs", "flat top 2.90 µs", "fall 4.15 µs", "139.2 V"]
    assert said[1] == ["start 8.00 µs", "rise 29.75 µs", "holds", "80.7 V"]
    x, y = whole.lines[0].get_data()
    np.testing.assert_allclose(y, drive.voltage(np.asarray(x)), atol=1e-9)
    np.testing.assert_allclose(y, sum(axes.lines[0].get_ydata() for axes in (first, second)), atol=1e-9)


def test_switches_that_stay_open_have_a_colour_and_a_dash_of_their_own(data: ReportData) -> None:
    assert data.best_design is not None
    traces = data.best_design.traces
    assert traces is not None
    closed = np.arange(len(traces.closed)) > 3
    design = dataclasses.replace(data.best_design, traces=dataclasses.replace(traces, closed=closed))
    figure = FIGURES["response"](dataclasses.replace(data, designs=(design, *data.designs[1:])))
    assert figure is not None
    closes, stays = (c for c in figure.axes[1].collections)
    assert (len(closes.get_paths()), len(stays.get_paths())) == (int(closed.sum()), int((~closed).sum()))
    assert closes.get_colors()[0].tolist() != stays.get_colors()[0].tolist()
    assert closes.get_linestyles() != stays.get_linestyles()
