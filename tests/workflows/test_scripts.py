"""Claims about the analysis scripts: each is short, reads stores through the public reader alone, and works."""

from __future__ import annotations

import ast
import re
import runpy
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from softclose.waveform import Waveform
from softclose_store import Campaign, open_campaign

FOLDER = Path(__file__).parents[2] / "scripts"
SCRIPTS = sorted(p for p in FOLDER.glob("*.py") if not p.name.startswith("generate_"))  # those write source code
ALLOWED = {"argparse", "math", "sys", "matplotlib", "numpy", "pandas", "xarray", "softclose_store"}


def run(name: str, *arguments: str, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the script has at its end."""
    import matplotlib as mpl
    import matplotlib.pyplot as plt

    mpl.use("Agg")
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    left: dict[str, Any] = runpy.run_path(str(FOLDER / name), run_name="__main__")
    plt.close("all")
    return left


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.name)
def test_a_script_is_short_and_uses_the_public_reader_only(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 100
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            assert {a.name.partition(".")[0] for a in node.names} <= ALLOWED
        if isinstance(node, ast.ImportFrom):
            module = str(node.module)
            assert module.partition(".")[0] in ALLOWED
            if module.startswith("softclose"):
                assert (module, [a.name for a in node.names]) == ("softclose_store", ["open_campaign"])
    assert re.search(rf"python scripts/{script.name} runs/", ast.get_docstring(ast.parse(text)) or "")


@pytest.mark.parametrize(
    ("script", "extra"),
    [
        ("best_waveform.py", ()),
        ("phase_portrait.py", ("--switches", "20")),
        ("animate_closing.py", ("--frames", "5")),
    ],
)
def test_a_figure_is_drawn(
    finished_store: Path, tmp_path: Path, script: str, extra: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    from PIL import Image

    target = tmp_path / ("a.gif" if script.startswith("animate") else "a.png")
    run(script, str(finished_store), "-o", str(target), *extra, monkeypatch=monkeypatch)
    with Image.open(target) as image:
        assert min(image.size) > 200
        assert getattr(image, "n_frames", 1) == (5 if script.startswith("animate") else 1)
        assert np.asarray(image.convert("L")).std() > 5  # not blank


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.name)
def test_a_wrong_path_is_one_line_and_no_traceback(
    script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as e:
        run(script.name, str(tmp_path / "nothing.zarr"), monkeypatch=monkeypatch)
    assert e.value.code == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert f"{script.name}: error: " in last
    assert "nothing.zarr" in last


def test_the_drive_is_drawn_with_its_peaks_and_dips(
    finished_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not on the instants of the trajectories, which are 1 µs apart or more."""
    left = run("best_waveform.py", str(finished_store), "-o", str(tmp_path / "a.png"), monkeypatch=monkeypatch)
    (line,) = left["axes"][0].lines
    drive = Waveform.from_rows(left["best"].waveform)
    t = np.linspace(0.0, left["t"][-1], 200_001)
    assert line.get_ydata().max() == pytest.approx(drive.max_voltage(left["t"][-1]), abs=0.02)
    np.testing.assert_allclose(np.interp(t, *line.get_data()), drive.voltage(t), atol=0.05)


def test_the_phase_portrait_has_a_corner_at_each_impact_and_nowhere_else(
    finished_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = run("phase_portrait.py", str(finished_store), "-o", str(tmp_path / "a.png"), monkeypatch=monkeypatch)
    campaign, responses = left["campaign"], left["responses"]
    travel, smooth = campaign.population()["D"], left["smooth"]
    for i in range(left["n"]):
        x, v = smooth(i)
        assert x.max() <= travel[i] * 1.01
        speeds = responses.impact_speed[i]
        jumps = np.flatnonzero(np.abs(np.diff(v)) > 0.02)  # 2 cm/s between two of eight points of 1 µs or less
        for speed in speeds[np.isfinite(speeds) & (speeds > 0.02)]:
            assert np.isclose(v, speed, atol=1e-9).any()
        assert np.allclose(x[jumps], travel[i], rtol=0.02) or responses.n_impacts[i] > speeds.size


def test_scales_that_are_the_same_for_all_make_no_nan(
    finished_store: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    own = Campaign.population

    def with_scales(self: Campaign) -> dict[str, np.ndarray]:
        found = dict(own(self))
        return found | {"voltage_scale": np.ones(len(found["D"])), "time_scale": np.ones(len(found["D"]))}

    monkeypatch.setattr(Campaign, "population", with_scales)
    run("worst_switches.py", str(finished_store), "-n", "3", monkeypatch=monkeypatch)
    printed = capsys.readouterr().out
    assert "voltage_scale" in printed
    assert "NaN" not in printed


def test_a_candidate_that_leaves_the_lot_open_is_not_ranked_by_its_energy(
    finished_store: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shares = open_campaign(finished_store).history()["p_nc"]
    most = float(np.sort(shares)[4])
    run("bounce_energy.py", str(finished_store), "-n", "99", "--most-open", repr(most), monkeypatch=monkeypatch)
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[3:]]
    assert sorted(int(row[0]) for row in rows) == sorted(shares.index[shares <= most])
    with pytest.raises(SystemExit):
        run("bounce_energy.py", str(finished_store), "--most-open", "-1", monkeypatch=monkeypatch)


def test_convergence_draws_several_stores(
    finished_store: Path,
    another_store: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    target = tmp_path / "c.png"
    run("convergence.py", str(finished_store), str(another_store), "-o", str(target), monkeypatch=monkeypatch)
    best = [open_campaign(path).best() for path in (finished_store, another_store)]
    printed = capsys.readouterr().out
    assert target.exists()
    assert all(b is not None and f"best g {b.g_cm_s:.2f} cm/s" in printed for b in best)


def test_worst_switches_are_the_hardest_impacts(
    finished_store: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run("worst_switches.py", str(finished_store), "-n", "3", monkeypatch=monkeypatch)
    campaign = open_campaign(finished_store)
    best = campaign.best()
    assert best is not None
    hardest = 100 * np.nanmax(campaign.responses(best.candidate).max_contact_speed)
    assert f"{hardest:.3f}" in capsys.readouterr().out


def test_rescoring_with_the_campaign_s_own_objective_gives_its_own_g(
    finished_store: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run("rescore.py", str(finished_store), "-n", "1", monkeypatch=monkeypatch)
    best = open_campaign(finished_store).best()
    assert best is not None
    row = capsys.readouterr().out.splitlines()[-1].split()
    assert int(row[0]) == best.candidate
    assert float(row[1]) == pytest.approx(best.g_cm_s, abs=1e-3)
    assert row[-1] == "1"


def test_energies_come_from_the_stored_impacts(
    finished_store: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run("bounce_energy.py", str(finished_store), "--most-open", "1", monkeypatch=monkeypatch)
    assert "energy_90_nJ" in capsys.readouterr().out


def test_histories_of_several_stores_make_one_table(
    finished_store: Path, another_store: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run("history_to_csv.py", str(finished_store), str(another_store), monkeypatch=monkeypatch)
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 1 + 12 + 6
    assert rows[0].startswith("store,candidate,")
