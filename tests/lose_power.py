"""Takes the power from a small campaign after its steps, and looks whether what comes back is what was promised.

`make power-loss` does so after every step, in three ways each, with and without `durable`; the test suite after some.
What is asked of each loss:

* With `durable`: everything committed is there, `verify` finds nothing, and the campaign ends in the same bits.
* Without: the store opens or says to repair it; one pass of repair leaves a store in which `verify` finds nothing, says
  what it made again, and the campaign ends in the same bits.
* In both: once the creation has returned, the store is there.
"""

from __future__ import annotations

import argparse
import random
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import small_store
from power_loss import LOSSES, Disk, Recorder, recording
from softclose_store import DamageError, DriverStore, remove_orphans, repair, store_state, verify
from softclose_store.write.block import forget_writer
from stores import differences


@dataclass(frozen=True)
class Recorded:
    """A campaign, and what it did to the disk."""

    final: Path
    recorder: Recorder
    durable: bool


def record(base: Path, *, durable: bool) -> Recorded:
    """The small campaign of the store's tests, from its creation to its end."""
    base.mkdir()
    path = base / "a.zarr"
    with recording(base) as recorder:
        small_store.create(path, durable=durable)
        recorder.mark(0)
        with DriverStore(path) as store:
            while store.n_committed < small_store.layout().n_candidates:
                small_store.run_wave(store)
                recorder.mark(store.n_committed)
    forget_writer(path)
    return Recorded(path, recorder, durable)


def losses(recorded: Recorded, base: Path, every: int) -> Iterator[tuple[Path, Disk, str]]:
    """(store, disk, what the loss was): each kind of loss after each so many steps."""
    disk = Disk()
    for n, step in enumerate(recorded.recorder.steps):
        disk.do(step)
        for k, loss in enumerate(LOSSES):
            if (n + k) % every == 0:
                place = base / f"{n}-{loss.replace(' ', '-')}"
                disk.lose_power(place, loss, random.Random(n))
                yield place / "a.zarr", disk, f"after step {n}, {loss}"
                shutil.rmtree(place)


def survive(recorded: Recorded, path: Path, disk: Disk, what: str) -> str:
    """Bring the campaign to its end after a loss; returns how. Raises AssertionError where a promise is broken."""
    state = store_state(path)
    assert state.kind != "foreign", what
    how = "intact"
    if recorded.durable:
        assert state.kind in ("absent", "campaign"), what
        assert state.n_committed >= disk.promised, what
        assert state.kind == "absent" or verify(path).ok, (what, verify(path).problems)
    if state.kind in ("absent", "unfinished"):
        assert disk.promised < 0, what
        small_store.create(path, durable=recorded.durable)
        how = "not created yet"
    else:
        told = _opened(path)
        assert not told or "verify" in told, what
        if not verify(path).ok:
            done = repair(path, small_store.recompute())
            assert done.ok, (what, done.failed, done.after.problems)
            assert done.proved or done.unproved, what
            how = "repaired"
    small_store.run(path)
    remove_orphans(path)
    forget_writer(path)
    assert verify(path).ok, what
    assert differences(path, recorded.final) == [], what
    return how


def _opened(path: Path) -> str:
    """What a driver is told at the opening; empty where it may go on."""
    try:
        DriverStore(path).close()
    except DamageError as e:
        return str(e)
    return ""


def main() -> None:
    """Every step, three losses each, with and without `durable`."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--every", type=int, default=1, help="steps between two losses")
    every = parser.parse_args().every
    for durable in (True, False):
        with tempfile.TemporaryDirectory() as folder:
            recorded = record(Path(folder) / "disk", durable=durable)
            told = Counter(survive(recorded, *loss) for loss in losses(recorded, Path(folder), every))
        name = "durable" if durable else "not durable"
        print(f"{name}: {sum(told.values())} losses of power; {dict(told)}", flush=True)


if __name__ == "__main__":
    main()
