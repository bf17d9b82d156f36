"""Claims about campaigns of a series at once: their stores are those of one after the other, whatever happens."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from campaigns import SMALL, command, softclose
from softclose.settings import load_config
from softclose_store import open_campaign, store_state
from softclose_workflows.errors import ExecutorError, Stopped
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.executors.protocol import Contact
from softclose_workflows.run.stopping import StopRequest
from softclose_workflows.studies.at_once import run_at_once
from stores import differences

STUDY = """
name = "seeds"
base = "current"
parameter = "campaign.seed"
values = {values}
"""


def _arguments(folder: Path, out: str, *more: str, n: int = 3) -> list[str]:
    file = folder / "seeds.toml"
    file.write_text(STUDY.format(values=list(range(1, n + 1))))
    settings = [part for setting in (*SMALL, "explore.budget=0", "finish.budget=0") for part in ("--set", setting)]
    return ["study", str(file), "--out", str(folder / out), "--switches", "100", "--top", "1", "-q", *settings, *more]


@pytest.mark.slow
@pytest.mark.parametrize("n", [2, pytest.param(3, marks=pytest.mark.long)])
def test_at_once_leaves_what_one_after_the_other_leaves(n: int, tmp_path: Path) -> None:
    engine = () if n == 3 else ("--set", "optimiser.engine=sobol")  # a Gaussian process is slow to import
    in_turn = softclose(*_arguments(tmp_path, "turn", "--serial", *engine, n=n))
    at_once = softclose(*_arguments(tmp_path, "once", "--workers", "2", "--at-once", str(n), *engine, n=n))
    assert (in_turn.returncode, at_once.returncode) == (0, 0), at_once.stderr
    assert at_once.stdout == in_turn.stdout
    for store in sorted((tmp_path / "turn").glob("*.zarr")):
        assert differences(store, tmp_path / "once" / store.name) == []


@pytest.mark.long
@pytest.mark.slow
def test_a_signal_stops_all_and_the_same_command_continues(tmp_path: Path) -> None:
    more = ("--workers", "2", "--at-once", "2", "--set", "campaign.budget=24")
    study = subprocess.Popen(
        command(*_arguments(tmp_path, "a", *more)), stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    )
    stores = [tmp_path / "a" / f"seed-{i}.zarr" for i in (1, 2, 3)]
    end = time.monotonic() + 90.0
    while not all(s.exists() and store_state(str(s)).n_committed > 4 for s in stores[:2]):
        assert time.monotonic() < end
        assert study.poll() is None
        time.sleep(0.1)
    study.send_signal(signal.SIGTERM)
    _, said = study.communicate(timeout=60)
    assert study.returncode == 3, said
    assert "SIGTERM received" in said
    assert not store_state(str(stores[2])).n_committed
    again = softclose(*_arguments(tmp_path, "a", *more))
    assert again.returncode == 0, again.stderr
    assert all(open_campaign(str(s)).finished for s in stores)


def test_without_workers_to_share_it_is_refused(tmp_path: Path) -> None:
    done = softclose(*_arguments(tmp_path, "a", "--serial", "--at-once", "2"))
    assert done.returncode == 2
    assert "--at-once needs workers that several drivers can share" in done.stderr


@pytest.mark.parametrize("missing", [True, pytest.param(False, marks=pytest.mark.long)])
def test_where_one_fails_its_words_are_told_and_no_other_begins(missing: bool, tmp_path: Path) -> None:
    store = str(tmp_path / "a.zarr")
    if not missing:
        create_store(load_config("current", [*SMALL, "explore.budget=0", "finish.budget=0"]), store)
    said: list[str] = []
    contact = Contact(address="tcp://127.0.0.1:9", environment={})
    with pytest.raises(ExecutorError) as e:
        run_at_once([store, store], contact, 1, patience_s=1.0, stop=StopRequest(), say=said.append)
    assert store in str(e.value)
    assert ("no campaign at" if missing else "no Dask scheduler answers") in str(e.value)
    assert len(said) == 1


def test_a_signal_reaches_the_drivers_also_where_no_campaign_waits_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each has a session of its own: what the terminal sends to ours does not reach it."""
    endless = (
        "import signal, sys, time; signal.signal(signal.SIGTERM, lambda *_: sys.exit(3)); print(1); time.sleep(60)"
    )

    def driver(path: str, contact: Contact, patience_s: float) -> subprocess.Popen[str]:
        started = subprocess.Popen([sys.executable, "-uc", endless], stdout=subprocess.PIPE, text=True)
        assert started.stdout is not None
        started.stdout.readline()  # it listens now
        return started

    monkeypatch.setattr("softclose_workflows.studies.at_once._driver", driver)
    stop = StopRequest()
    began = time.monotonic()
    with pytest.raises(Stopped, match="SIGTERM received"):
        run_at_once(
            ["a", "b"],
            Contact(address="", environment={}),
            2,
            patience_s=1.0,
            stop=stop,
            say=lambda line: setattr(stop, "signal_name", "SIGTERM" if "2/2" in line else None),
        )
    assert time.monotonic() - began < 30.0
