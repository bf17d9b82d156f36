"""Claims about ask and tell: measured responses are stored, judged and certified as simulated ones are."""

from __future__ import annotations

import errno
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benches import DEVICES, FRESH, SETTINGS, STEPS, Interrupt, begin, content, cut_at, finish, measure
from campaigns import softclose
from examples import in_turn
from small_campaigns import COARSE, make_campaign
from softclose import ModelError, Responses, Waveform, simulate
from softclose.evaluate import judge
from softclose.metrics import paired
from softclose.metrics.objective import CM_S, MISSING, Assessment, Judged, assess
from softclose.settings import CampaignConfig
from softclose_store import DriverStore, LockedError, OtherConfigurationError, open_campaign, repair, verify
from softclose_workflows import api
from softclose_workflows.analyses.certification import CertifyError
from softclose_workflows.analyses.certify import read_certification
from softclose_workflows.analyses.recompute import recompute
from softclose_workflows.api.bench import Bench
from softclose_workflows.errors import BenchError, Stopped
from softclose_workflows.run.measurements import commit_told


def untimed(response: Responses) -> Responses:
    """What a vibrometer says of a response: speeds, and who is closed, but not from when on."""
    return replace(response, settling_us=np.full(response.closed.shape, np.nan))


def test_what_is_told_is_on_record_with_its_intervals(tmp_path: Path) -> None:
    with begin(tmp_path / "a.zarr") as bench:
        for k in range(7):
            suggestion = bench.ask()
            assert bench.ask() == suggestion
            assert (suggestion.candidate, suggestion.n_devices) == (k, 20)
            told = bench.tell(k, *measure(suggestion.waveform, DEVICES))
            assert told == assess(untimed(simulate(DEVICES, suggestion.waveform)), max_open=1.0)
        assert bench.finished
        with pytest.raises(BenchError, match=r"all 7 candidates of .* are measured"):
            bench.ask()
    campaign = open_campaign(tmp_path / "a.zarr")
    records = campaign.records()
    assert records["g_cm_s"][6] == told.g_cm_s
    assert (records["g_lower_cm_s"][6], records["p_nc_wilson_upper"][6]) == (
        told.g_interval[0],
        told.p_nc_intervals.wilson[1],
    )
    assert "trust-region" in records["origin"].tolist()  # the engine has learnt from what was told
    assert verify(tmp_path / "a.zarr").ok


def test_no_measurement_is_lost_and_the_campaign_goes_on_as_if_it_had_not_stopped(tmp_path: Path) -> None:
    with begin(tmp_path / "whole.zarr") as bench:
        finish(bench)
    with begin(tmp_path / "cut.zarr") as bench:
        finish(bench, 3)  # within the wave of the design
    measured = []
    for _ in range(4):
        with Bench(tmp_path / "cut.zarr") as bench:
            measured.append(bench.ask().candidate)
            finish(bench, 1)
    assert measured == [3, 4, 5, 6]
    a, b = (open_campaign(tmp_path / name).records() for name in ("whole.zarr", "cut.zarr"))
    for name in ("waveform", "g_cm_s", "origin"):
        np.testing.assert_array_equal(a[name], b[name])


def test_other_commands_read_it_and_none_simulates_it(tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    with begin(store) as bench:
        finish(bench, 5)
        bench.ask()
    stopped = softclose("resume", str(store), "--serial")
    assert stopped.returncode == 2
    assert "the responses of this campaign are measured" in stopped.stderr
    with Bench(store) as bench:
        finish(bench)
    for words in (["status"], ["report", "-o", str(tmp_path / "a.html")], ["export"], ["verify", "--replay", "3"]):
        more = ["waveform", "-o", str(tmp_path / "w.csv")] if words == ["export"] else []
        done = softclose(words[0], str(store), *words[1:], *more)
        assert done.returncode == 0, done.stderr
    for words in (["certify", "--switches", "300"], ["tolerance"], ["sensitivity", "--points", "16"]):
        done = softclose(words[0], str(store), *words[1:])
        assert done.returncode == 2, done.stdout
        assert "api.Bench" in done.stderr
    (damaged,) = [p for p in (store / "search" / "response").iterdir() if p.name == "c.6.0.0"]
    damaged.write_bytes(b"")
    done = softclose("verify", str(store), "--repair")
    assert done.returncode != 0
    assert "was measured: nothing computes it again" in done.stdout + done.stderr


def test_a_certificate_is_measured_on_other_devices_and_counts_as_any(tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    with begin(store) as bench:
        finish(bench)
        best = bench.best
        assert best is not None
        drive = Waveform.from_rows(best.waveform)
        found = bench.certify(*measure(drive, FRESH))
        with pytest.raises(CertifyError, match="10 new switches certify nothing here"):
            bench.certify(*measure(drive, FRESH[:10]))
    assert found.best.candidate == best.candidate
    assert found.best.assessment == assess(untimed(simulate(FRESH, drive)), max_open=1.0)
    again = read_certification(str(store))
    assert again is not None
    assert again.best.assessment.g_cm_s == found.best.assessment.g_cm_s
    assert softclose("export", str(store), "waveform", "-o", str(tmp_path / "w.csv")).returncode == 0


@pytest.mark.parametrize(
    ("speeds", "closed", "status"),
    in_turn(
        [
            pytest.param(np.ones(19), None, None),
            pytest.param(np.ones((20, 1)), None, None),
            pytest.param(-np.ones(20), None, None),
            pytest.param(np.full(20, np.inf), None, None),
            pytest.param(np.full(20, np.nan), np.ones(20, dtype=bool), None),  # closed, and no speed at all
            pytest.param(np.full(20, np.nan), None, None),  # nothing read
            pytest.param(np.ma.masked_all(20), np.ones(20, dtype=bool), None),
            pytest.param(np.ones(20), None, np.full(20, -1)),
            pytest.param(np.ones(20), None, np.full(20, 127)),
            pytest.param(np.ones(20), None, np.full(20, 0.5)),
            pytest.param(np.ones(20), np.ones(20), None),  # no truth values
            pytest.param(np.ones(20), np.ones(19, dtype=bool), None),
            pytest.param(np.ones(20), None, [1]),
            pytest.param("fast", None, None),
            pytest.param(None, None, None),
            pytest.param([1.0, "x"] * 10, None, None),
        ],
        4,
    ),
)
def test_measurements_that_do_not_fit_are_refused_and_nothing_is_stored(
    speeds: object, closed: object, status: object, tmp_path: Path
) -> None:
    with begin(tmp_path / "a.zarr") as bench:
        with pytest.raises(BenchError, match="expected are 20 speeds of 0 cm/s or more, NaN where"):
            bench.tell(0, speeds, closed, status=status)
        with pytest.raises(BenchError, match="candidate 3 is told, but 0 was asked for"):
            bench.tell(3, np.ones(20))
    with Bench(tmp_path / "a.zarr") as bench:
        assert bench.ask().candidate == 0


def test_a_lost_measurement_counts_as_not_closed(tmp_path: Path) -> None:
    status = np.zeros(20, dtype=int)
    status[:2] = 1
    with begin(tmp_path / "a.zarr") as bench:
        told = bench.tell(bench.ask().candidate, np.linspace(1.0, 20.0, 20), status=status)
    assert (told.n_failed, told.n_contact, told.n_closed) == (2, 18, 18)
    assert told.p_nc == 0.1
    assert told.mean_cm_s == pytest.approx(np.linspace(1.0, 20.0, 20)[2:].mean())


def test_a_bench_needs_a_campaign_of_its_own(tmp_path: Path) -> None:
    with pytest.raises(BenchError, match="holds no campaign yet: give a preset"):
        Bench(tmp_path / "a.zarr")
    simulated = make_campaign(tmp_path / "b.zarr", *COARSE)
    with pytest.raises(BenchError, match="holds a campaign of the device model single-mode"):
        Bench(simulated)
    with pytest.raises(ModelError, match="the responses of this campaign are measured"):
        api.run("current", tmp_path / "c.zarr", settings=("model.name=measured",), serial=True)
    assert not (tmp_path / "c.zarr").exists()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """The records of the small campaign that nothing has interrupted."""
    store = tmp_path_factory.mktemp("whole") / "a.zarr"
    with begin(store, 5) as bench:
        finish(bench)
    return open_campaign(store).records()


def reopened(store: Path, bench: Bench) -> Bench:
    bench.close()
    return Bench(store)


def same_bench(store: Path, bench: Bench) -> Bench:
    return bench


@pytest.mark.parametrize(
    ("cut", "again"),
    [(Interrupt("stopped"), reopened), (OSError(errno.ENOSPC, "no space left"), same_bench)],
    ids=["stopped", "full"],
)
@pytest.mark.parametrize("step", in_turn(STEPS, 5))
def test_a_bench_cut_at_any_step_goes_on_as_if_it_had_not_been(
    step: str,
    cut: BaseException,
    again: Callable[[Path, Bench], Bench],
    whole: dict[str, np.ndarray],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    store = tmp_path / "a.zarr"
    bench = begin(store, 5)
    finish(bench, 3)
    with monkeypatch.context() as patch:  # in the block or in the commit of the last candidate of the design
        cut_at(patch, step, 1, cut)
        with pytest.raises((Interrupt, OSError, Stopped)):
            finish(bench, 1)
    bench = again(store, bench)
    stored = STEPS.index(step) >= STEPS.index("after-marker")
    assert bench.ask().candidate == (4 if stored else 3)
    finish(bench)
    bench.close()
    found = open_campaign(store).records()
    for name in ("waveform", "g_cm_s", "origin"):
        np.testing.assert_array_equal(found[name], whole[name])
    assert verify(store).ok


def test_opening_and_repair_commit_what_was_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = tmp_path / "a.zarr"
    with begin(store, 4) as bench:
        finish(bench, 3)
        with monkeypatch.context() as patch:
            cut_at(patch, "before-commit", 1, OSError(errno.ENOSPC, "no space left"))
            with pytest.raises(Stopped, match="wave 0 could not be committed"):
                finish(bench, 1)
    assert open_campaign(store).committed == 0
    before = content(store)
    assert repair(store, recompute()).after.ok
    assert commit_told(str(store)) == 4
    assert commit_told(str(store)) == 0
    after = content(store)
    blocks = [name for name in before if name.startswith("search/")]
    assert blocks
    assert all(before[name] == after[name] for name in blocks)  # what was measured is as it was told
    assert verify(store).n_committed == 4
    with Bench(store) as bench:
        assert bench.finished


def test_closed_means_closed(tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    with begin(store, 1) as bench:
        suggestion = bench.ask()
    before = content(store)
    for action in (
        bench.ask,
        lambda: bench.tell(suggestion.candidate, np.ones(20)),
        lambda: bench.certify(np.ones(100)),
    ):
        with pytest.raises(BenchError, match="is closed: open it again"):
            action()
    assert content(store) == before
    with Bench(store) as bench:
        assert bench.ask() == suggestion
        finish(bench)
    with pytest.raises(BenchError, match="is closed"):
        bench.ask()


@pytest.mark.parametrize("released", [False, True])
def test_what_another_has_committed_is_never_replaced(tmp_path: Path, released: bool) -> None:
    store = tmp_path / "a.zarr"
    lost = begin(store, 2)
    suggestion = lost.ask()
    other = DriverStore(store, break_lock=True)
    if released:  # the other has been there and gone, and a third goes on
        other.close()
        with Bench(store) as bench:
            finish(bench, 1)
    before = content(store)
    for action in (
        lost.ask,
        lambda: lost.tell(suggestion.candidate, np.full(20, 7.0)),
        lambda: lost.certify(np.ones(100)),
    ):
        with pytest.raises(LockedError, match="was broken"):
            action()
    assert content(store) == before
    lost.close()
    other.close()
    assert verify(store).ok


@pytest.mark.parametrize(
    ("source", "more", "differs"),
    in_turn(
        [
            pytest.param("current-three", {}, "waveform.space"),
            pytest.param("current", {"devices": 30}, "population.n_switches: the store has 20, this configuration 30"),
            pytest.param("current", {"budget": 9}, "campaign.budget: the store has 2, this configuration 9"),
            pytest.param("current", {"settings": (*SETTINGS, "waveform.max_volts=30")}, "waveform.max_volts"),
            pytest.param("current", {"settings": ("prior.model=none",)}, "optimiser.n_initial"),
            pytest.param(None, {"settings": ("waveform.max_volts=30",)}, "waveform.max_volts"),
            pytest.param(None, {"devices": 21}, "population.n_switches"),
            pytest.param(None, {"budget": 3}, "campaign.budget"),
        ],
        3,
    ),
)
def test_reopening_with_other_arguments_is_refused_and_says_what_differs(
    source: str | None, more: dict[str, object], differs: str, tmp_path: Path
) -> None:
    store = tmp_path / "a.zarr"
    begin(store, 2).close()
    before = content(store)
    with pytest.raises(OtherConfigurationError, match=differs):
        Bench(store, source, **({"settings": SETTINGS} if source else {}) | more)
    assert content(store) == before
    for same in ({}, {"devices": 20, "budget": 2}, {"source": "current", "settings": SETTINGS}):
        Bench(store, **same).close()
    begin(store, 2).close()


def test_missing_open_and_closed_without_a_speed_are_three_things(tmp_path: Path) -> None:
    store, speeds = tmp_path / "a.zarr", np.linspace(5.0, 24.0, 20)
    closed = np.ones(20, dtype=bool)
    speeds[:3], closed[:3] = np.nan, False  # open
    speeds[3:5] = np.nan  # closed, at a speed that is not known
    masked = np.ma.array(speeds, mask=np.arange(20) >= 16)  # nothing read, whatever stands there
    masked.data[16:] = -7.0
    with begin(store, 1) as bench:
        found = bench.tell(bench.ask().candidate, masked, closed)
    assert (found.n, found.n_closed, found.n_contact, found.n_failed) == (16, 13, 11, 0)
    assert (found.p_nc, found.p_contact) == (3 / 16, 13 / 16)
    assert found.mean_cm_s == pytest.approx(np.linspace(5.0, 24.0, 20)[5:16].mean())
    record = open_campaign(store).records()
    assert (record["p_nc"][0], record["g_cm_s"][0]) == (found.p_nc, found.g_cm_s)
    again = judge_stored(store)
    assert (again.n, again.g_cm_s) == (found.n, found.g_cm_s)


def judge_stored(store: Path) -> Assessment:
    """What is judged of the stored responses of candidate 0."""
    campaign = open_campaign(store)
    return judge(CampaignConfig.from_dict(campaign.config), campaign.responses(0))


@pytest.mark.parametrize("where", ["speeds", "closed", "status", "nan"])
def test_what_was_not_read_is_not_counted_and_what_it_hides_is_never_seen(
    where: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(7)
    speeds, mask = rng.uniform(5.0, 30.0, 20), rng.random(20) < 0.3
    given = {"speeds": speeds, "closed": np.ones(20, dtype=bool), "status": np.zeros(20, dtype=int)}
    if where == "nan":
        given["speeds"], given["closed"] = np.where(mask, np.nan, speeds), None
    else:
        given[where] = np.ma.array(given[where], mask=mask)
    with begin(tmp_path / "a.zarr", 1) as bench:
        found = bench.tell(0, given["speeds"], given["closed"], status=given["status"])
    rest = speeds[~mask] / CM_S
    response = Judged(
        max_contact_speed=rest, closed=np.ones(rest.size, dtype=bool), status=np.zeros(rest.size, dtype=np.int8)
    )
    assert 0 < rest.size < 20
    assert found.n == rest.size
    assert found.g_interval == assess(response).g_interval
    assert ("count as missing" in capsys.readouterr().err) == (where == "nan")


@pytest.mark.parametrize("slip", [0.01, 100.0])
def test_speeds_a_hundredfold_off_are_asked_about(slip: float, tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    with begin(store, 1) as bench:
        speeds, closed = measure(bench.ask().waveform, DEVICES)
        before = content(store)
        with pytest.raises(BenchError, match="Are the speeds in cm/s"):
            bench.tell(0, speeds * slip, closed)
        assert content(store) == before
        assert bench.tell(0, speeds * slip, closed, unusual=True).n == 20
        with pytest.raises(BenchError, match="Are the speeds in cm/s"):
            bench.certify(np.linspace(5.0, 30.0, 80) * slip)


def test_pairs_leave_out_what_was_not_read() -> None:
    rng = np.random.default_rng(3)

    def drawn(n_missing: int) -> Judged:
        status = np.zeros(60, dtype=np.int8)
        status[rng.choice(60, n_missing, replace=False)] = MISSING
        lost = status == MISSING
        return Judged(max_contact_speed=np.where(lost, np.nan, rng.uniform(0.1, 0.4, 60)), closed=~lost, status=status)

    a, b = drawn(5), drawn(9)
    both = (a.status == 0) & (b.status == 0)
    found = paired.compare((a, assess(a)), (b, assess(b)))
    assert found.p_nc == 0.0  # what is missing is not open
    assert found.softer.n == both.sum()
