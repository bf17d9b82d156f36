"""Claims about more candidates for a finished campaign, and about a start from the candidates of another one."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from campaigns import softclose
from small_campaigns import COARSE, COMPLETE, finish, make_campaign
from softclose import ALGORITHM
from softclose.propose.plan import plan
from softclose.propose.protocol import Problem
from softclose.settings import ConfigError, load_config
from softclose_store import DamageError, OtherConfigurationError, StoreError, open_campaign, repair, verify
from softclose_store.write import extend as writing
from softclose_workflows.analyses.recompute import recompute
from softclose_workflows.run.creation import layout_of
from softclose_workflows.run.driving import drive
from softclose_workflows.run.executors import Placement
from softclose_workflows.run.extension import extend
from softclose_workflows.run.warm_start import warm_started
from stores import differences, files_of

SEARCH = (*COMPLETE, "explore.budget=0", "finish.budget=0", "campaign.budget=7")
"""Four points of the design, then waves of two of the surrogate, the last cut short."""
TABLES = ("records", "words", "digests", "surrogate", "wall_times")
GROWING = ("candidate", "stage", "engine")
"""What is known of every candidate beforehand."""


@pytest.fixture(scope="module", params=[SEARCH, COMPLETE], ids=["search", "descents"])
def finished(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(make_campaign(tmp_path_factory.mktemp("finished") / "a.zarr", *request.param))


ONE = pytest.mark.parametrize(
    "finished",
    [pytest.param(SEARCH, marks=pytest.mark.long, id="search"), pytest.param(COMPLETE, id="descents")],
    indirect=True,
)
"""`make test` extends one of the two; `make long` both."""


@pytest.fixture
def store(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "a.zarr"))


def contents(path: Path) -> dict[str, bytes]:
    return {file.relative_to(path).as_posix(): file.read_bytes() for file in files_of(path)}


@ONE
def test_an_extension_leaves_what_was_there_and_says_both_budgets(store: Path, finished: Path) -> None:
    n = open_campaign(store).budget
    extend(str(store), n + 5)
    grown = open_campaign(store)
    assert (grown.budget, grown.committed, grown.finished) == (n + 5, n, False)
    finish(store)
    before, after = contents(finished), contents(store)
    changed = {key for key, content in before.items() if after[key] != content}
    metadata = {
        "zarr.json",
        "candidates/digests/root.json",
        "runtime/zarr.json",
        *(f"candidates/{name}/zarr.json" for name in (*TABLES, *GROWING)),
    }
    grown = (*TABLES, *GROWING, "hyperparameter")
    last = {key for key in changed - metadata if key.startswith(tuple(f"candidates/{name}/" for name in grown))}
    assert changed - metadata == last  # blocks, population and names are what they were, byte by byte
    groups = [xr.open_zarr(path, group="candidates") for path in (store, finished)]
    with groups[0] as ds, groups[1] as old:
        assert ds.sizes["candidate"] == n + 5
        for name in ("records", "words", "digests"):
            xr.testing.assert_identical(ds[name].isel(candidate=slice(0, n)), old[name])
        assert np.isfinite(ds["records"].sel(field="g_cm_s")).all()
    extended = open_campaign(store)
    noted = next(run for run in extended.runtime["runs"] if "extended_from_candidates" in run)
    assert noted["extended_from_candidates"] == n
    assert noted["extended_from_fingerprint"] == open_campaign(finished).fingerprint != extended.fingerprint
    assert extended.config["campaign"]["extensions"] == [5]
    assert verify(store).ok


def test_the_plan_of_what_was_done_stays(finished: Path) -> None:
    config = load_config("current", SEARCH if open_campaign(finished).budget == 7 else COMPLETE)
    first = plan(Problem(config))
    once = plan(Problem(config.extended(config.total_budget + 5)))
    twice = plan(Problem(config.extended(config.total_budget + 5).extended(config.total_budget + 8)))
    assert once[: len(first)] == first
    assert twice[: len(once)] == once
    assert [sum(w.size for w in twice if w.stage == f"extend{k}") for k in (1, 2)] == [5, 3]


@ONE
def test_extensions_resume_replay_and_follow_each_other(store: Path, tmp_path: Path) -> None:
    other = Path(shutil.copytree(store, tmp_path / "other.zarr"))
    n = open_campaign(store).budget
    for total in (n + 5, n + 8):
        extend(str(store), total)
        finish(store)
        extend(str(other), total)
        for _ in range(4):
            finish(other, blocks=1)
            extend(str(other), total)  # the same words again change nothing
        finish(other)
    assert differences(store, other) == []
    done = softclose("verify", str(store), "--replay", "9")
    assert done.returncode == 0, done.stdout + done.stderr


@ONE
@pytest.mark.parametrize("step", [97, pytest.param(9, marks=pytest.mark.long)])
def test_an_extension_that_is_cut_off_is_completed_by_whoever_next_writes(
    step: int, store: Path, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = Path(shutil.copytree(store, tmp_path / "whole.zarr"))
    n = open_campaign(store).budget
    extend(str(whole), n + 5)
    finish(whole)
    write: Callable[..., Any] = writing.write_key
    keys = []
    monkeypatch.setattr(writing, "write_key", lambda *a: (keys.append(a[1]), write(*a)))
    extend(str(shutil.copytree(finished, tmp_path / "counted.zarr")), n + 5)
    assert keys[0] == "candidates/digests/extension.json"
    for k in range(0, len(keys), step):
        left = [k]

        def failing(*a: Any, left: list[int] = left) -> None:
            if left[0] == 0:
                raise OSError("the power went")
            left[0] -= 1
            write(*a)

        cut = Path(shutil.copytree(finished, tmp_path / f"cut{k}.zarr"))
        monkeypatch.setattr(writing, "write_key", failing)
        with pytest.raises(OSError, match="the power went"):
            extend(str(cut), n + 5)
        assert open_campaign(cut).finished
        assert verify(cut).ok
        assert verify(cut).extension == (n + 5 if k else 0)
        monkeypatch.setattr(writing, "write_key", write)
        mended = Path(shutil.copytree(cut, tmp_path / f"mended{k}.zarr"))
        assert repair(mended, recompute()).ok
        resumed = Path(shutil.copytree(cut, tmp_path / f"resumed{k}.zarr"))
        for path in (mended, resumed):
            drive(str(path), Placement(serial=True), quiet=True)  # resume, without --budget
        extend(str(cut), n + 5)
        finish(cut)
        for path in (mended, resumed, cut):
            if k or path == cut:
                assert differences(path, whole) == []
            else:
                assert differences(path, finished) == []
            assert verify(path).ok
            assert verify(path).extension == 0


@pytest.mark.parametrize(
    "key",
    [
        "population/K/c.0",
        "population/E/c.0",
        "candidates/records/c.0.0",
        "candidates/records/zarr.json",
        "search/zarr.json",
        "candidates/field/c.0",
    ],
)
def test_an_extension_does_not_swear_to_what_it_cannot_know(key: str, store: Path) -> None:
    (store / key).unlink()
    before = contents(store)
    with pytest.raises(DamageError, match=rf"{key} of .* is missing.*: run `softclose verify .* --repair`"):
        extend(str(store), open_campaign(store).budget + 5)
    assert contents(store) == before


def test_a_file_that_describes_no_extension_of_this_campaign_belongs_to_nothing(store: Path, tmp_path: Path) -> None:
    other = make_campaign(tmp_path / "other.zarr", *COARSE, run=False)
    (store / "candidates" / "digests" / "extension.json").write_bytes((Path(other) / "zarr.json").read_bytes())
    before = open_campaign(store).fingerprint
    assert [p.key for p in verify(store).problems] == ["candidates/digests/extension.json"]
    assert repair(store, recompute()).ok
    assert open_campaign(store).fingerprint == before


def test_what_cannot_be_extended_is_refused(tmp_path: Path, store: Path) -> None:
    n = open_campaign(store).budget
    with pytest.raises(ConfigError, match=f"has {n} candidates; give a larger total than {n - 1}"):
        extend(str(store), n - 1)
    unfinished = make_campaign(tmp_path / "b.zarr", *COARSE, run=False)
    with pytest.raises(StoreError, match="holds 0 of 8 candidates: it can be extended once it is finished"):
        extend(unfinished, 20)
    config = load_config("current", (*SEARCH, "campaign.seed=2")).extended(12)
    with pytest.raises(OtherConfigurationError, match="an extension keeps it"):
        writing.extend_campaign(store, layout=layout_of(config), config=config.to_dict(), algorithm=ALGORITHM, note={})
    assert verify(store).ok


def test_a_campaign_begins_with_the_best_of_another_store(store: Path, tmp_path: Path) -> None:
    records = open_campaign(store).records()
    settings = ("campaign.budget=12", "campaign.seed=3", f"waveform.initial_from={store}", "waveform.initial_count=3")
    config = warm_started(load_config("current", (*COARSE, *settings)))
    assert len(config.waveform.initial) == 3
    most = records["n_switches"] == records["n_switches"].max()
    best = np.flatnonzero(most)[np.nanargmin(records["g_cm_s"][most])]
    assert config.waveform.initial_waveforms()[0].rows().tolist() == records["waveform"][best].tolist()
    assert warm_started(config) == config
    done = softclose(
        "run",
        "current",
        "--store",
        str(tmp_path / "b.zarr"),
        "--serial",
        "--quiet",
        *(word for setting in (*COARSE, *settings) for word in ("--set", setting)),
    )
    assert done.returncode == 0, done.stderr
    assert open_campaign(tmp_path / "b.zarr").records()["origin"][:3].tolist() == ["initial"] * 3
    with pytest.raises(ConfigError, match=r"has no candidate to begin with: .* 0 of its"):
        warm_started(load_config("current", (*COARSE, *settings, "waveform.max_volts=20")))
