"""Claims about exports: instruments and simulators get the waveform within the stated error, files appear whole."""

from __future__ import annotations

import errno
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given, settings
from hypothesis import strategies as st

from examples import examples
from softclose.waveform import Pulse, Waveform
from softclose_store import open_campaign
from softclose_workflows.cli import main
from softclose_workflows.errors import ExportError
from softclose_workflows.exports.pwl import STEP_EDGE_US, draw, spice_source
from softclose_workflows.exports.samples import CodeScale, metadata, sample_times_us, volts_csv
from softclose_workflows.exports.tables import ensemble_dataset, history_dataset
from softclose_workflows.tell.outputs import OutputError, whole_file, write_text


def export(store: Path, *arguments: str) -> Result:
    return CliRunner().invoke(main, ["export", str(store), *arguments])


def best_waveform(store: Path) -> Waveform:
    best = open_campaign(store).best()
    assert best is not None
    return Waveform.from_rows(best.waveform)


pulses = st.builds(
    Pulse,
    start_us=st.floats(0, 150),
    rise_us=st.floats(4, 80),
    peak_us=st.one_of(st.floats(0, 60), st.just(math.inf)),
    volts=st.floats(0, 150),
)


@given(waveform=st.lists(pulses, min_size=1, max_size=3).map(Waveform), tolerance=st.sampled_from([1e-1, 1e-3]))
@settings(max_examples=examples(25), deadline=None)
def test_straight_lines_stay_within_the_stated_error_everywhere(waveform: Waveform, tolerance: float) -> None:
    line = draw(waveform, tolerance)
    assert line.times_us[0] == 0.0
    assert (np.diff(line.times_us) > 0).all()
    inside = np.linspace(line.times_us[:-1], line.times_us[1:], 17).ravel()
    t = np.concatenate([inside, [line.times_us[-1] + 1000.0]])
    error = np.interp(t, line.times_us, line.volts) - waveform.voltage(t)
    assert np.abs(error).max() <= tolerance * (1 + 1e-6) + 1e-9


def test_fewer_points_suffice_for_a_larger_tolerance() -> None:
    waveform = Waveform([Pulse(0, 4, 5, 150), Pulse(20, 30, math.inf, 80)])
    sizes = [draw(waveform, tolerance).times_us.size for tolerance in (1e-4, 1e-3, 1e-2)]
    assert sizes[0] > 2.5 * sizes[1] > 6 * sizes[2]  # the count goes as the root of 1/tolerance


def test_ideal_steps_become_short_edges() -> None:
    line = draw(Waveform([Pulse(0, 0, 10, 100), Pulse(25, 0, math.inf, 40)]))
    expected = [(0, 0), (STEP_EDGE_US, 100), (10, 100), (10 + STEP_EDGE_US, 0), (25, 0), (25 + STEP_EDGE_US, 40)]
    np.testing.assert_allclose(np.column_stack([line.times_us, line.volts]), expected)


def test_there_are_no_more_points_than_the_tolerance_asks_for() -> None:
    line = draw(Waveform([Pulse(0, 20, math.inf, 150)]), 1e-3)
    # Chords of h² |u''| = 8 tolerance: the integral of sqrt(|u''| / (8 tolerance)) over a raised cosine, 2.3963 from θ.
    fewest = math.sqrt(150 / 16e-3) * 2.3963
    assert fewest < line.times_us.size < 1.05 * fewest


def test_points_are_counted_before_they_fill_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    waveform = Waveform([Pulse(0, 20, math.inf, 150)])
    n = draw(waveform, 0.1).times_us.size
    monkeypatch.setattr("softclose_workflows.exports.pwl.MAX_POINTS", n)
    assert draw(waveform, 0.1).times_us.size == n
    monkeypatch.setattr("softclose_workflows.exports.pwl.MAX_POINTS", n - 1)
    with pytest.raises(ExportError, match=f"more than {n - 1} points"):
        draw(waveform, 0.1)


@pytest.mark.parametrize(
    ("tolerance", "words"), [(math.inf, "is inf V"), (math.nan, "is nan V"), (1e-30, "beyond double precision")]
)
def test_a_tolerance_that_bounds_nothing_is_refused(tolerance: float, words: str) -> None:
    with pytest.raises(ExportError, match=words):
        draw(Waveform([Pulse(0, 4, 5, 150)]), tolerance)


def test_a_spice_source_is_in_volts_over_seconds_between_its_nodes() -> None:
    line = draw(Waveform([Pulse(0, 0, 10, 100), Pulse(25, 20, math.inf, 40)]), 0.25)
    assert line.has_steps
    text = spice_source(line, source="Vx", nodes="plus minus", comments=["for a test"])
    first, second, name, *points, last = text.splitlines()
    assert first == "* for a test"
    assert second.startswith(f"* {line.times_us.size} points; linear interpolation is within 250 mV; ideal steps take ")
    assert "take 0.1 ns" in second
    assert (name, last, text[-1]) == ("Vx plus minus PWL(", "+ )", "\n")
    table = np.array([[float(v) for v in row.removeprefix("+ ").split()] for row in points])
    np.testing.assert_allclose(table, np.column_stack([line.times_us / 1e6, line.volts]), rtol=1e-11)
    ramps = draw(Waveform([Pulse(0, 4, math.inf, 40)]), 0.25)
    assert "ideal steps" not in spice_source(ramps, comments=[])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"source": "V1 0 0\n.include x"}, "begins with V"),
        ({"nodes": "a b c"}, "two names"),
        ({"nodes": "a b;c"}, "two names"),
    ],
)
def test_names_that_a_netlist_would_read_otherwise_are_refused(options: dict[str, str], words: str) -> None:
    line = draw(Waveform([Pulse(0, 4, math.inf, 40)]), 0.25)
    with pytest.raises(ExportError, match=words):
        spice_source(line, comments=[], **options)


@pytest.mark.parametrize(
    "waveform",
    [
        Waveform([Pulse(0, 4, 5.31, 150), Pulse(25, 20, math.inf, 75)]),
        Waveform([Pulse(0, 6, 3, 90), Pulse(10, 15, 20, 60), Pulse(70, 40, 30, 110)]),
        Waveform([Pulse(0, 0, math.inf, 100)]),
    ],
    ids=["two pulses, held", "three overlapping, released", "ideal step"],
)
def test_ngspice_plays_the_source_within_its_stated_error(ngspice: str, tmp_path: Path, waveform: Waveform) -> None:
    line = draw(waveform, 1e-3)
    (tmp_path / "drive.cir").write_text(spice_source(line, comments=["a test"]))
    played = run_ngspice(ngspice, tmp_path)
    t, volts = played[:, 0] * 1e6, played[:, 1]
    assert t[-1] == pytest.approx(250.0)
    assert t.size > 2000
    settled = np.ones(t.size, dtype=bool)
    if line.has_steps:
        settled = t > 2 * STEP_EDGE_US  # the step itself takes its stated edge
    error = np.abs(volts - waveform.voltage(t))[settled]
    assert error.max() < 1.1e-3


def run_ngspice(program: str, folder: Path) -> np.ndarray:
    """Columns time [s] and v(drive) [V] of a transient analysis over 250 µs."""
    import subprocess

    (folder / "test.cir").write_text(
        "waveform test\n.include drive.cir\nC1 drive 0 1p\n.control\nset numdgt=12\nset wr_singlescale\n"
        "tran 0.1u 250u 0 0.1u\nwrdata played.txt v(drive)\nquit\n.endc\n.end\n"
    )
    done = subprocess.run(
        [program, "-b", "test.cir"], cwd=folder, capture_output=True, text=True, timeout=60, check=False
    )
    assert (folder / "played.txt").exists(), done.stdout + done.stderr
    return np.loadtxt(folder / "played.txt")


def test_ngspice_reads_what_the_command_writes(ngspice: str, finished_store: Path, tmp_path: Path) -> None:
    done = export(
        finished_store, "waveform", "--format", "pwl", "--tolerance", "0.5", "-o", str(tmp_path / "drive.cir")
    )
    assert done.exit_code == 0, done.output
    played = run_ngspice(ngspice, tmp_path)
    error = played[:, 1] - best_waveform(finished_store).voltage(played[:, 0] * 1e6)
    assert np.abs(error).max() < 0.6e-3


def test_csv_holds_the_waveform_at_the_asked_rate(finished_store: Path, tmp_path: Path) -> None:
    target = tmp_path / "drive.csv"
    assert export(finished_store, "waveform", "--rate", "4", "-o", str(target)).exit_code == 0
    table = np.loadtxt(target, delimiter=",", skiprows=1)
    np.testing.assert_allclose(table[:, 0], np.arange(1001) / 4)
    np.testing.assert_allclose(table[:, 1], best_waveform(finished_store).voltage(table[:, 0]), atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "also"),
    [
        (("waveform",), ""),
        (("waveform", "--format", "dac", "--full-scale", "200"), ".json"),
        (("history",), ""),
    ],
)
def test_what_was_written_is_said_as_every_command_says_it(
    finished_store: Path, tmp_path: Path, arguments: tuple[str, ...], also: str
) -> None:
    target = tmp_path / "out.csv"
    done = export(finished_store, *arguments, "-o", str(target))
    assert done.stdout == ""
    for name in {str(target), f"{target}{also}"}:
        size = Path(name).stat().st_size
        assert f"written: {name} ({size / 1e3:.{1 if size < 1e4 else 0}f} kB)\n" in done.stderr


@pytest.mark.parametrize("signed", [True, False])
def test_codes_return_the_waveform_within_half_a_code(finished_store: Path, tmp_path: Path, signed: bool) -> None:
    target = tmp_path / "drive.txt"
    flag = "--signed" if signed else "--unsigned"
    done = export(
        finished_store,
        "waveform",
        "--format",
        "dac",
        "--bits",
        "12",
        "--full-scale",
        "200",
        flag,
        "--no-header",
        "--rate",
        "5",
        "--duration",
        "100",
        "-o",
        str(target),
    )
    assert done.exit_code == 0, done.output
    about = json.loads((tmp_path / "drive.txt.json").read_text())
    codes = np.loadtxt(target, dtype=int)
    assert codes.size == about["n_samples"] == 501
    assert about["volts_per_code"] == pytest.approx(200 / (2047 if signed else 4095))
    t = np.arange(codes.size) / about["rate_MSps"]
    error = codes * about["volts_per_code"] - best_waveform(finished_store).voltage(t)
    assert np.abs(error).max() <= about["largest_rounding_error_V"] + 1e-12 <= about["volts_per_code"] / 2 + 2e-12


def test_the_largest_code_is_the_full_scale() -> None:
    scale = CodeScale(bits=8, full_scale_V=150.0, signed=False, rate_MSps=1.0)
    codes = scale.encode(np.array([0.0, 75.0, 150.0]))
    assert codes.tolist() == [0, 128, 255]
    assert metadata(scale, codes, np.array([0.0, 75.0, 150.0]))["final_volts_to_hold"] == 150.0
    with pytest.raises(ExportError, match="above the full scale"):
        scale.encode(np.array([0.0, 151.0]))


@pytest.mark.parametrize(
    ("bits", "signed", "largest"), [(2, True, 1), (12, True, 2047), (12, False, 4095), (32, False, 2**32 - 1)]
)
def test_the_largest_code_of_a_generator(bits: int, signed: bool, largest: int) -> None:
    assert CodeScale(bits=bits, full_scale_V=1.0, signed=signed, rate_MSps=1.0).max_code == largest


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ({"bits": 1}, "1 bits"),
        ({"bits": 33}, "33 bits"),
        *(({"full_scale_V": v}, "full scale is") for v in (0.0, -0.5)),
    ],
)
def test_a_generator_that_cannot_be_is_refused(setting: dict[str, float], words: str) -> None:
    with pytest.raises(ExportError, match=words):
        CodeScale(**({"bits": 8, "full_scale_V": 1.0, "signed": False, "rate_MSps": 1.0} | setting))  # type: ignore[arg-type]


def test_metadata_say_what_the_codes_are_worth() -> None:
    scale = CodeScale(bits=2, full_scale_V=30.0, signed=False, rate_MSps=1.0)  # 10 V a code
    volts = np.array([0.0, 8.0, 21.0, 14.0])
    about = metadata(scale, scale.encode(volts), volts)
    assert (about["smallest_code"], about["largest_code"], about["n_samples"]) == (0, 2, 4)
    assert about["largest_rounding_error_V"] == pytest.approx(4.0)
    assert about["largest_step_between_samples_V"] == pytest.approx(13.0)
    assert about["final_volts_to_hold"] == pytest.approx(10.0)
    one = np.array([20.0])
    assert metadata(scale, scale.encode(one), one)["largest_step_between_samples_V"] == 0.0


def test_samples_reach_the_end() -> None:
    assert sample_times_us(10.0, 250.0)[-1] == 250.0
    assert sample_times_us(3.0, 1.0).tolist() == pytest.approx([0, 1 / 3, 2 / 3, 1])
    assert sample_times_us(0.5, 3.0).tolist() == [0.0, 2.0, 4.0]
    assert sample_times_us(1.1, 10.0).size == 12  # 1.1 × 10 is above 11 by rounding alone
    with pytest.raises(ExportError, match="sample rate is inf"):
        sample_times_us(math.inf, 1.0)


def test_a_text_of_samples_is_time_in_microseconds_and_volts() -> None:
    text = volts_csv(Waveform([Pulse(0, 0, math.inf, 100)]), np.array([0.0, 2.5]))
    assert text == "time_us,volts\n0,100\n2.5,100\n"


def test_a_history_has_volts_in_volts_and_times_in_microseconds(finished_store: Path) -> None:
    campaign = open_campaign(finished_store)
    history = history_dataset(campaign)
    columns = [str(name) for name in history if str(name).startswith("pulse")]
    assert {n.split("_")[0] for n in columns} == {"pulse1", "pulse2"}
    for k, name in ((0, "start_us"), (1, "rise_us"), (2, "peak_us"), (3, "volts")):
        assert history[f"pulse1_{name}"].attrs["units"] == ("V" if name == "volts" else "µs")
        np.testing.assert_array_equal(history[f"pulse1_{name}"], [campaign.waveform(i)[0, k] for i in range(12)])
    assert history["g_cm_s"].attrs["units"] == "cm/s"
    assert history["origin"].attrs["units"] == "1"


def test_an_ensemble_has_every_response_under_its_own_name(finished_store: Path) -> None:
    campaign = open_campaign(finished_store)
    ds, r = ensemble_dataset(campaign, 3), campaign.responses(3)
    assert set(ds.dims) == {"switch"}
    for name, values, unit in (
        ("max_contact_speed", r.max_contact_speed, "µm/µs"),
        ("first_contact", r.first_contact_us, "µs"),
        ("settling", r.settling_us, "µs"),
        ("closed", r.closed, "1"),
    ):
        np.testing.assert_array_equal(ds[name], values)
        assert ds[name].attrs["units"] == unit
    assert (ds["G"].attrs["units"], ds["E"].attrs["units"]) == ("µm", "GPa")
    assert "gap" in ds["G"].attrs["long_name"]
    assert json.loads(ds.attrs["waveform"])[-1][2] is None  # holds
    assert json.loads(ds.attrs["waveform"])[0] == campaign.waveform(3)[0].tolist()


def test_a_format_whose_package_is_missing_says_what_to_install(
    finished_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    done = export(finished_store, "history", "--format", "parquet", "-o", str(tmp_path / "a.parquet"))
    assert done.exit_code == 2
    assert "pip install " in done.output


def test_a_disk_that_is_full_is_said_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(source: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(OutputError, match="No space left on device"):
        write_text(tmp_path / "a.csv", "1")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("form", ["csv", "parquet", "netcdf"])
def test_tables_survive_the_trip_through_every_format(finished_store: Path, tmp_path: Path, form: str) -> None:
    pd = pytest.importorskip("pandas")
    xr = pytest.importorskip("xarray")
    campaign = open_campaign(finished_store)
    read = {
        "csv": lambda p: pd.read_csv(p),
        "parquet": lambda p: pd.read_parquet(p),
        "netcdf": lambda p: xr.load_dataset(p).to_dataframe(),
    }[form]
    for kind in ("history", "ensemble"):
        target = tmp_path / f"{kind}.{form}"
        done = export(finished_store, kind, "--format", form, "-o", str(target))
        assert done.exit_code == 0, done.output
        table = read(target)
        if kind == "history":
            np.testing.assert_array_equal(table["g_cm_s"], campaign.records()["g_cm_s"])
            assert list(table["origin"]) == [str(v) for v in campaign.records()["origin"]]
        else:
            best = campaign.best()
            assert best is not None
            np.testing.assert_array_equal(table["D"], campaign.population()["D"])
            np.testing.assert_array_equal(
                table["max_contact_speed"], campaign.responses(best.candidate).max_contact_speed
            )


def test_netcdf_carries_trajectories_units_and_provenance(finished_store: Path, tmp_path: Path) -> None:
    xr = pytest.importorskip("xarray")
    target = tmp_path / "best.nc"
    done = export(
        finished_store, "ensemble", "--candidate", "3", "--format", "netcdf", "--trajectories", "-o", str(target)
    )
    assert done.exit_code == 0, done.output
    campaign = open_campaign(finished_store)
    with xr.open_dataset(target) as ds:
        np.testing.assert_array_equal(ds["x"], campaign.trajectories(3).x[...])
        assert ds["x"].dims == ("switch", "time")
        np.testing.assert_array_equal(ds["v"], campaign.trajectories(3).v[...])
        np.testing.assert_array_equal(ds["time"], campaign.times_us)
        assert [ds[name].attrs["units"] for name in ("time", "x", "v")] == ["µs", "µm", "µm/µs"]
        np.testing.assert_array_equal(ds["impact_time"], campaign.responses(3).impact_time_us)
        np.testing.assert_array_equal(ds["impact_speed"], campaign.responses(3).impact_speed)
        assert ds["impact_time"].sizes["impact"] == 8
        assert ds["x"].encoding["zlib"]
        assert ds["x"].encoding["shuffle"]
        assert not ds["D"].encoding["zlib"]
        assert ds["G"].attrs["units"] == "µm"
        assert ds.attrs["fingerprint"] == campaign.fingerprint
        assert json.loads(ds.attrs["config"]) == campaign.config


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("waveform", "--rate", "0"), "sample rate is 0"),
        (("waveform", "--rate", "1e9"), "at most 10,000,000"),
        (("waveform", "--duration", "-1"), "duration is -1"),
        (("waveform", "--candidate", "99"), "candidate 99 is not committed"),
        (("waveform", "--format", "pwl", "--tolerance", "0"), "tolerance is 0 V"),
        (("waveform", "--format", "pwl", "--source", "I1"), "begins with V"),
        (("waveform", "--format", "pwl", "--nodes", "a"), "two names"),
        (("waveform", "--format", "dac", "--bits", "99", "--full-scale", "200"), "2 to 32"),
        (("waveform", "--format", "dac", "--full-scale", "1"), "above the full scale"),
        (("ensemble", "--trajectories"), "netcdf"),
        (("history", "--format", "parquet", "-o", "-"), "give a file"),
        (("history", "--format", "xlsx"), "'csv', 'parquet', 'netcdf'"),
    ],
)
def test_a_bad_option_is_one_message_exit_2_and_no_file(
    finished_store: Path, tmp_path: Path, arguments: tuple[str, ...], says: str
) -> None:
    if "-o" not in arguments:
        arguments = (*arguments, "-o", str(tmp_path / "out"))
    done = export(finished_store, *arguments)
    assert done.exit_code == 2
    assert says in done.output
    assert "Traceback" not in done.output
    assert list(tmp_path.iterdir()) == []


def test_a_missing_folder_or_a_folder_as_target_is_refused(finished_store: Path, tmp_path: Path) -> None:
    for target in (tmp_path, tmp_path / "absent" / "drive.csv"):
        done = export(finished_store, "waveform", "-o", str(target))
        assert done.exit_code == 2
        assert str(target.name) in done.output


def test_a_failing_writer_leaves_the_old_file_and_nothing_beside(tmp_path: Path) -> None:
    target = tmp_path / "drive.csv"
    target.write_text("old")

    def fail() -> None:
        with whole_file(target) as partial:
            partial.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert [p.name for p in tmp_path.iterdir()] == ["drive.csv"]
    assert target.read_text() == "old"


def test_a_missing_store_is_one_message(tmp_path: Path) -> None:
    done = export(tmp_path / "none.zarr", "waveform")
    assert done.exit_code == 2
    assert "none.zarr" in done.output
