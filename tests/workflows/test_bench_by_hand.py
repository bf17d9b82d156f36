"""Claims about what a person changes of a bench: readings corrected and withdrawn, waveforms chosen, all on record."""

from __future__ import annotations

import errno
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benches import DEVICES, STEPS, Interrupt, begin, content, cut_at, finish, measure
from campaigns import softclose
from examples import in_turn
from softclose import Waveform
from softclose.propose import origins
from softclose_store import DamageError, DriverStore, LockedError, open_campaign, repair, verify
from softclose_store.read.by_hand import CHOSEN
from softclose_workflows import api
from softclose_workflows.analyses.recompute import recompute, replay
from softclose_workflows.api import Bench
from softclose_workflows.bench.readings_file import read_readings
from softclose_workflows.bench.waveform_file import read_waveform
from softclose_workflows.errors import BenchError, Stopped
from softclose_workflows.report.gather import gather
from softclose_workflows.report.health import health
from softclose_workflows.run.extension import extend
from softclose_workflows.run.measurements import commit_told

MINE = Waveform.from_rows([[0.0, 5.0, 10.0, 100.0], [25.0, 20.0, np.inf, 90.0]])
WRONG = np.linspace(40.0, 60.0, 20)


def wrongly(bench: Bench) -> None:
    """Tell what no device did."""
    bench.tell(bench.ask().candidate, WRONG)


def truth(store: Path, candidate: int) -> tuple[np.ndarray, np.ndarray]:
    return measure(Waveform.from_rows(open_campaign(store).waveform(candidate)), DEVICES)


def engine_numbers(store: Path) -> dict[str, np.ndarray]:
    records = open_campaign(store).records()
    return {name: records[name] for name in ("waveform", "g_cm_s", "v_u_cm_s", "p_nc", "origin", "failed")}


def same(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> None:
    for name, values in a.items():
        np.testing.assert_array_equal(values, b[name], err_msg=name)


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The campaign of which every reading was right when it was told."""
    store = tmp_path_factory.mktemp("right") / "a.zarr"
    with begin(store, 6) as bench:
        finish(bench)
    return store


@pytest.fixture(scope="module")
def mistaken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its first two candidates, of which the second was told wrongly, before anything was proposed from them."""
    store = tmp_path_factory.mktemp("mistaken") / "a.zarr"
    with begin(store, 6) as bench:
        finish(bench, 1)
        wrongly(bench)
    return store


@pytest.fixture
def store(mistaken: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(mistaken, tmp_path / "a.zarr"))


def put_right(bench: Bench) -> None:
    waveform = Waveform.from_rows(design(bench)[1])
    bench.correct(1, *measure(waveform, DEVICES), reason="the range of the vibrometer")


def design(bench: Bench) -> list[np.ndarray]:
    """Waveforms of the wave in flight, which is not committed."""
    (flight,) = bench._driver._flights.values()
    return [p.waveform.rows() for p in flight.proposals]


def test_what_was_put_right_counts_for_everything_that_follows(store: Path, right: Path) -> None:
    with Bench(store) as bench:
        put_right(bench)
        finish(bench)
    same(engine_numbers(store), engine_numbers(right))
    campaign = open_campaign(store)
    assert campaign.records_as_told()["mean_cm_s"][1] == pytest.approx(50.0)
    assert campaign.records()["note"][1] == "readings corrected: the range of the vibrometer"
    assert verify(store).ok
    assert replay(str(store), 9).ok


@pytest.mark.parametrize("withdrawn", ["corrected", "some", "all"])
def test_every_reader_says_what_counts_and_nothing_committed_is_written_again(
    withdrawn: str, right: Path, tmp_path: Path
) -> None:
    store = Path(shutil.copytree(right, tmp_path / "a.zarr"))
    best = open_campaign(store).best()
    assert best is not None
    i = best.candidate
    before, told = content(store), open_campaign(store).responses(i)
    with Bench(store) as bench:
        if withdrawn == "corrected":
            found = bench.correct(i, WRONG, reason="m/s")
        else:
            found = bench.withdraw(i, [2, 5] if withdrawn == "some" else None, reason="=slip [/b]")
    after = content(store)
    changed = {name for name, value in before.items() if after[name] != value}
    assert changed <= {"zarr.json", "runtime/zarr.json"}, "the list of groups, and who opened it"
    campaign = open_campaign(store)
    records, responses = campaign.records(), campaign.responses(i)
    if found is None:
        assert (records["failed"][i], records["failure"][i]) == (True, "withdrawn: =slip [/b]")
        assert (responses.status == 127).all()
        assert campaign.best().candidate != i
    else:
        assert records["g_cm_s"][i] == found.g_cm_s
        assert found.n == (20 if withdrawn == "corrected" else 18)
        kept = [k for k in range(20) if k not in (2, 5)]
        expected = WRONG / 100.0 if withdrawn == "corrected" else told.max_contact_speed
        np.testing.assert_array_equal(responses.max_contact_speed[kept], expected[kept])
    table, tree = campaign.dataset(), campaign.datatree()
    names = [str(name) for name in table["field"].values]
    g = table["records"].to_numpy()[i, names.index("g_cm_s")]
    np.testing.assert_array_equal(g, records["g_cm_s"][i])
    np.testing.assert_array_equal(tree["candidates"]["records"], table["records"])
    speeds = campaign.dataset("search")["response"].to_numpy()[i, :, 0]
    np.testing.assert_array_equal(speeds, responses.max_contact_speed)
    np.testing.assert_array_equal(tree["search"]["response"].to_numpy()[i, :, 0], speeds)
    standing = api.status(store)
    (said,) = standing.changes
    assert said.startswith(f"candidate {i}: readings {'corrected' if withdrawn == 'corrected' else 'withdrawn'}: ")
    assert softclose("status", str(store), "--json").stdout.count(said.partition(": ")[2]) == 1
    data = gather(str(store), learned=False)
    assert next(check for check in health(data) if check.name == "By hand").said.count(said[1:]) == 1
    again = {row["candidate"]: row for row in api.rescore(store, ["level=0.9"]).to_frame().to_dict("records")}
    assert (i in again) == (found is not None)
    if found is not None:
        assert again[i]["v_u [cm/s]"] == found.v_u_cm_s
    history = softclose("export", str(store), "history").stdout.splitlines()[1 + i]
    assert ("withdrawn: =slip" in history) == (withdrawn != "corrected")
    assert verify(store).ok


def test_the_last_word_counts_and_a_withdrawal_can_be_undone(right: Path, tmp_path: Path) -> None:
    store = Path(shutil.copytree(right, tmp_path / "a.zarr"))
    with Bench(store) as bench:
        bench.withdraw(2, reason="wrong wafer")
        bench.correct(2, WRONG, reason="again")
        bench.withdraw(2, [0], reason="slip")
        assert bench.withdraw(2, range(1, 20), reason="the others too") is None
        bench.correct(2, *truth(store, 2), reason="it was right after all")
    same(engine_numbers(store), engine_numbers(right))
    assert [change.kind for change in open_campaign(store).by_hand] == [
        "withdrawal",
        "correction",
        "withdrawal",
        "withdrawal",
        "correction",
    ]


def test_a_waveform_that_was_shown_is_not_taken_back(right: Path, tmp_path: Path) -> None:
    """What is in flight was proposed from what was known: it is the same after a correction, reopened or not."""
    store = tmp_path / "a.zarr"
    with begin(store, 6) as bench:
        finish(bench, 4)
        shown = bench.ask()
        bench.correct(0, WRONG, reason="test")
        assert bench.ask() == shown
    with Bench(store) as bench:
        assert bench.ask() == shown
        finish(bench, 1)
        later = bench.ask()
    assert replay(str(store), 9).ok
    assert later.waveform != Waveform.from_rows(open_campaign(right).waveform(5)), "the next one has seen it"


def test_a_waveform_chosen_by_hand_is_on_record_as_such_and_learnt_from(right: Path, tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    with begin(store, 6) as bench:
        finish(bench, 2)
        told = bench.tell(2, *measure(MINE, DEVICES), waveform=MINE, reason="a guess")
        finish(bench, 2)
        bench.tell(bench.ask().candidate, *measure(MINE, DEVICES), waveform=MINE.rows().tolist())
        assert bench.finished
    campaign = open_campaign(store)
    records = campaign.records()
    assert origins.BY_HAND == CHOSEN
    assert records["origin"].tolist()[2] == records["origin"].tolist()[5] == CHOSEN
    assert records["engine"].tolist() == ["skopt", "skopt", CHOSEN, "skopt", "skopt", CHOSEN]
    assert records["stage"].tolist() == ["search"] * 6
    assert campaign.dataset()["engine"].to_numpy().tolist() == records["engine"].tolist()
    assert records["note"].tolist()[2::3] == ["chosen by hand: a guess", "chosen by hand"]
    np.testing.assert_array_equal(campaign.waveform(2), MINE.rows())
    assert records["g_cm_s"][2] == told.g_cm_s
    plain = open_campaign(right)
    np.testing.assert_array_equal(campaign.waveform(3), plain.waveform(3))  # of the design, which looks at nothing
    assert (campaign.waveform(4) != plain.waveform(4)).any()
    assert verify(store).ok
    assert replay(str(store), 9).ok


def test_telling_the_waveform_that_was_asked_for_is_no_choice(tmp_path: Path) -> None:
    with begin(tmp_path / "a.zarr", 2) as bench:
        asked = bench.ask()
        bench.tell(0, *measure(asked.waveform, DEVICES), waveform=asked.waveform)
    assert open_campaign(tmp_path / "a.zarr").by_hand == ()


@pytest.mark.parametrize(
    ("rows", "why"),
    [
        ([[0.0, 5.0, 10.0, 151.0]], "150"),
        ([[0.0, 1.0, 10.0, 50.0]], "rise"),
        ([[60.0 * k, 5.0, 10.0, 50.0] for k in range(3)], "3 pulses"),
        ([[0.0, 5.0, 10.0]], "waveform cannot be applied"),
        ([[0.0, 5.0, np.nan, 50.0]], "waveform cannot be applied"),
        ("high", "waveform cannot be applied"),
    ],
)
def test_a_waveform_that_the_campaign_does_not_allow_is_refused(rows: Any, why: str, tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    with begin(store, 2) as bench:
        bench.ask()
        before = content(store)
        with pytest.raises(BenchError, match=why):
            bench.tell(0, np.full(20, 20.0), waveform=rows)
        with pytest.raises(BenchError, match="expected are 20 speeds"):
            bench.tell(0, np.full(19, 20.0), waveform=MINE)
        assert content(store) == before


ACTIONS: dict[str, Callable[[Bench], object]] = {
    "correct": put_right,
    "withdraw": lambda bench: bench.withdraw(0, [4], reason="slip"),
    "choose": lambda bench: bench.tell(2, *measure(MINE, DEVICES), waveform=MINE),
}


@pytest.fixture(scope="module", params=ACTIONS)
def action(request: pytest.FixtureRequest, mistaken: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """An action, and what the campaign is at its end where nothing cut it off."""
    store = Path(shutil.copytree(mistaken, tmp_path_factory.mktemp("uncut") / "a.zarr"))
    with Bench(store) as bench:
        ACTIONS[request.param](bench)
        finish(bench)
    return ACTIONS[request.param], engine_numbers(store)


@pytest.mark.parametrize("full", [False, pytest.param(True, marks=pytest.mark.long)], ids=["killed", "full"])
@pytest.mark.parametrize(
    "at", in_turn([*(("inside-group", k) for k in (1, 2, 4, 8, 11, 14)), *((step, 1) for step in STEPS)], 14)
)
def test_a_change_that_is_cut_off_is_there_as_a_whole_or_not_at_all(
    at: tuple[str, int], full: bool, action: Any, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (step, passage), (act, whole) = at, action
    cut = OSError(errno.ENOSPC, "no space left") if full else Interrupt("stopped")
    bench = Bench(store)
    with monkeypatch.context() as patch:
        cut_at(patch, step, passage, cut)
        try:
            act(bench)
        except (Interrupt, OSError, Stopped):
            if not full:
                bench.close()
                bench = Bench(store)
            assert verify(store).problems == () or full
            if act is not ACTIONS["choose"] or bench.ask().candidate == 2:
                act(bench)
    finish(bench)
    bench.close()
    assert verify(store).ok
    same(engine_numbers(store), whole)
    assert replay(str(store), 9).ok


def test_repair_commits_and_proposes_with_what_was_changed(store: Path, right: Path) -> None:
    with Bench(store) as bench:
        put_right(bench)
        finish(bench)
    whole = content(store)
    for name in ("surrogate", "words", "records"):
        (store / "candidates" / name / "c.0.0").unlink()
    mended = repair(store, recompute())
    assert mended.ok, mended.failed
    assert content(store)["candidates/surrogate/c.0.0"] == whole["candidates/surrogate/c.0.0"]
    same(engine_numbers(store), engine_numbers(right))
    assert commit_told(str(store)) == 0


@pytest.mark.parametrize("what", ["lost", "chunk", "metadata"])
def test_a_change_that_is_damaged_is_never_overlooked(what: str, store: Path) -> None:
    with Bench(store) as bench:
        put_right(bench)
        finish(bench, 2)
    folder = store / "by-hand" / "000000"
    if what == "lost":
        shutil.rmtree(folder)
    elif what == "chunk":
        (folder / "response" / "c" / "0" / "0").write_bytes(b"\0")
    else:
        (folder / "zarr.json").unlink()
    for read in (
        lambda: open_campaign(store).records(),
        lambda: open_campaign(store).responses(1),
        lambda: Bench(store),
    ):
        with pytest.raises(DamageError, match="by-hand/000000"):
            read()
    assert not verify(store).ok
    mended = repair(store, recompute())
    assert mended.ok == (what == "metadata")
    if what == "chunk":
        assert any("nothing computes again: restore it from a copy" in line for line in mended.failed)
    if mended.ok:
        assert open_campaign(store).records()["note"][1].startswith("readings corrected")


def test_who_has_lost_the_store_changes_nothing(store: Path) -> None:
    lost = Bench(store)
    other = DriverStore(store, break_lock=True)
    before = content(store)
    for act in ACTIONS.values():
        with pytest.raises(LockedError, match="was broken"):
            act(lost)
    lost.close()
    other.close()
    for act in ACTIONS.values():
        with pytest.raises(BenchError, match="is closed"):
            act(lost)
    assert content(store) == before


@pytest.mark.parametrize(
    ("act", "why"),
    [
        (lambda b: b.correct(2, WRONG, reason="x"), "nothing was told of candidate 2"),
        (lambda b: b.correct(-1, WRONG, reason="x"), "nothing was told of candidate -1"),
        (lambda b: b.correct(True, WRONG, reason="x"), "nothing was told of candidate True"),
        (lambda b: b.withdraw("1", reason="x"), "nothing was told of candidate '1'"),
        (lambda b: b.correct(1, WRONG, reason=" "), "say why"),
        (lambda b: b.withdraw(1, reason=""), "say why"),
        (lambda b: b.correct(1, WRONG[:19], reason="x"), "expected are 20 speeds"),
        (lambda b: b.correct(1, WRONG * 100, reason="x"), "Are the speeds in cm/s"),
        (lambda b: b.withdraw(1, [20], reason="x"), "places from 0 to 19"),
        (lambda b: b.withdraw(1, [-1], reason="x"), "places from 0 to 19"),
        (lambda b: b.withdraw(1, [], reason="x"), "places from 0 to 19"),
        (lambda b: b.withdraw(1, [1.5], reason="x"), "places from 0 to 19"),
    ],
)
def test_what_cannot_be_changed_is_refused_and_nothing_is_written(act: Any, why: str, store: Path) -> None:
    with Bench(store) as bench:
        before = content(store)
        with pytest.raises(BenchError, match=why):
            act(bench)
        assert content(store) == before


def test_an_extension_goes_on_from_what_counts(right: Path, tmp_path: Path) -> None:
    store = Path(shutil.copytree(right, tmp_path / "a.zarr"))
    with Bench(store) as bench:
        bench.withdraw(3, reason="wrong wafer")
    extend(str(store), 8)
    with Bench(store) as bench:
        finish(bench)
    campaign = open_campaign(store)
    assert campaign.records()["failed"].tolist() == [i == 3 for i in range(8)]
    assert verify(store).ok
    assert replay(str(store), 20).ok


def test_the_command_line_asks_tells_corrects_and_withdraws(store: Path, tmp_path: Path) -> None:
    asked = json.loads(softclose("bench", "ask", str(store), "--json").stdout)
    assert (asked["candidate"], asked["n_devices"]) == (2, 20)
    table, mine = tmp_path / "speeds.csv", tmp_path / "mine.json"
    mine.write_text(json.dumps([[0, 5, 10, 100], [25, 20, None, 90]]))
    speeds, closed = measure(MINE, DEVICES)
    rows = [
        f"d{k};{'' if np.isnan(s) else repr(float(s))};{'yes' if c else 'no'}"
        for k, (s, c) in enumerate(zip(speeds, closed, strict=True))
    ]
    table.write_text("\n".join(["device;speed_cm_s;closed", *rows]).replace(".", ","))
    words = ["bench", "tell", str(store), "2", str(table), "--waveform", str(mine), "--reason", "a guess"]
    assert softclose(*words).returncode == 0
    done = softclose("bench", "correct", str(store), "1", str(table), "--reason", "read again")
    assert done.returncode == 0, done.stderr
    assert softclose("bench", "withdraw", str(store), "0", "--device", "3", "--reason", "slip").returncode == 0
    assert softclose("bench", "withdraw", str(store), "0", "--reason", "wafer").stdout.endswith("counts as failed\n")
    assert [(c.kind, c.candidate, c.reason) for c in open_campaign(store).by_hand] == [
        ("waveform", 2, "a guess"),
        ("correction", 1, "read again"),
        ("withdrawal", 0, "slip"),
        ("withdrawal", 0, "wafer"),
    ]
    for words in (["tell", str(store), "2", str(table)], ["correct", str(store), "9", str(table), "--reason", "x"]):
        assert softclose("bench", *words).returncode == 2
    with Bench(store) as bench:
        finish(bench)
    told = open_campaign(store).responses(2)
    np.testing.assert_array_equal(told.max_contact_speed * 100.0, speeds)
    np.testing.assert_array_equal(told.closed, closed)


def test_a_table_of_readings_tells_missing_open_and_closed_apart(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("device,speed_cm_s,closed,status\na,12.5,yes,0\nb,,no,\nc,,yes,\nd,,,\ne,nan,1,3\n")
    read = read_readings(str(path))
    assert read.closed is not None
    assert read.status is not None
    assert read.speeds_cm_s.mask.tolist() == [False, False, False, True, False]
    assert np.isnan(read.speeds_cm_s.data).tolist() == [False, True, True, True, True]
    assert read.closed.tolist()[:3] == [True, False, True]
    assert read.status.tolist() == [0, 0, 0, 0, 3]
    path.write_text("speed_cm_s\tx\n12.5\t1\n13.5\t2\n")
    assert read_readings(str(path)).closed is None


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("speed_m_s,closed\n0.1,yes\n", "no column 'speed_cm_s'"),
        ("speed_cm_s,closed\n12.5,maybe\n", "line 2: closed is 'maybe'"),
        ("speed_cm_s,closed\n12.5,\n", "line 2: a speed, and not whether it closed"),
        ("speed_cm_s,closed\nfast,yes\n", "speed_cm_s is 'fast'"),
        ("speed_cm_s,closed\ninf,yes\n", "speed_cm_s is 'inf'"),
        ("speed_cm_s,closed,status\n1,yes,late\n", "line 2: status is 'late'"),
        ("", "no table"),
    ],
)
def test_a_table_that_is_none_of_readings_is_refused_with_its_line(text: str, why: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(BenchError, match=why):
        read_readings(str(path))


@pytest.mark.parametrize("text", ["", "{}", "[1]", '"x"', "null", "[" * 5000, '[["a", 1, 2, 3]]', '{"waveform": 3}'])
def test_a_file_that_is_no_waveform_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(BenchError, match=r"a\.json"):
        read_waveform(str(path))
