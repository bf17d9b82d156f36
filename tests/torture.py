"""Kills campaigns at named steps and at random instants, resumes them, and compares the whole store bit for bit.

`make torture` runs 200 rounds; the test suite runs a few. Every round is reproducible but for the instant at which a
kill by the clock lands. A round also checks that nothing committed or marked was written again.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import psutil
import zarr

sys.path.insert(0, str(Path(__file__).parent / "workflows"))

from campaigns import run_arguments, softclose
from forked import Forked
from softclose_store.faults import POINTS
from stores import arrays_of, differences

IN_WORKERS = {"inside-chunk-write": 5, "before-marker": 1, "after-marker": 1}
"""Steps that a worker passes, and how often in one block, of five files."""

MAX_RESUMES = 6


@dataclass(frozen=True)
class Plan:
    """What one round does to its first run."""

    kind: str
    """point, driver, worker or both."""
    point: str = ""
    passage: int = 1
    after_s: float = 0.0
    workers: int = 0
    """0 runs the serial executor."""

    def __str__(self) -> str:
        where = f"{self.point}:{self.passage}" if self.kind == "point" else f"{self.kind} after {self.after_s:.2f} s"
        return f"{where} ({'serial' if not self.workers else f'{self.workers} workers'})"


def random_plan(rng: random.Random, duration_s: float) -> Plan:
    """Half of the rounds aim at a named step, half at an instant."""
    if rng.random() < 0.5:
        point, passage, workers = rng.choice(POINTS), rng.randint(1, 8), rng.choice((0, 0, 1, 2))
        if workers and point in IN_WORKERS:
            # Every replacement inherits the plan, so each must get past the step that killed the one before it:
            # otherwise the run rightly stops, which is another test's matter.
            passage += IN_WORKERS[point]
        return Plan(kind="point", point=point, passage=passage, workers=workers)
    kind = rng.choice(("driver", "worker", "both"))
    return Plan(kind=kind, after_s=rng.uniform(0.5, duration_s), workers=rng.choice((1, 2)))


def placement(plan: Plan) -> list[str]:
    """The executor options of a plan."""
    return ["--workers", str(plan.workers)] if plan.workers else ["--serial"]


def workers_of(driver: int) -> list[psutil.Process]:
    """Worker processes of a driver: those that its server of forks has forked."""
    try:
        family = psutil.Process(driver).children(recursive=True)
        return [p for p in family if p.ppid() != driver and "multiprocessing.forkserver" in " ".join(p.cmdline())]
    except psutil.Error:
        return []


def first_run(store: Path, plan: Plan, rng: random.Random) -> int:
    """Run the campaign under a plan; returns the driver's exit code (negative: the signal that ended it)."""
    env = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    if plan.kind == "point":
        env["SOFTCLOSE_FAULT"] = f"{plan.point}:{plan.passage}"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = Forked(*run_arguments(store), *placement(plan), env=env, **quiet)
    if plan.kind != "point":
        time.sleep(plan.after_s)
        if plan.kind in ("worker", "both") and (victims := workers_of(process.pid)):
            rng.choice(victims).send_signal(signal.SIGKILL)
        if plan.kind in ("driver", "both") and process.poll() is None:
            process.kill()
    try:
        return process.wait(timeout=120)
    except subprocess.TimeoutExpired:
        # A step that kills every worker it meets: the workers inherit the plan. The driver's own bound comes later.
        process.kill()
        return process.wait()


def marked_files(store: Path) -> dict[Path, int]:
    """File -> modification time [ns] of every chunk file of a block whose marker is written."""
    if not (store / "zarr.json").exists():
        return {}
    try:
        arrays = arrays_of(store)
    except (KeyError, ValueError, zarr.errors.GroupNotFoundError):
        return {}
    found = {}
    for name, markers in arrays.items():
        stage, _, last = name.rpartition("/")
        if last != "block_digest":
            continue
        for i, j in zip(*(markers[...] != 0).all(axis=-1).nonzero(), strict=True):
            for other, array in arrays.items():
                dims = array.metadata.dimension_names
                if other.startswith(f"{stage}/") and dims and tuple(dims[:2]) == ("candidate", "switch"):
                    key = array.metadata.encode_chunk_key((int(i), int(j), *(0 for _ in dims[2:])))
                    file = store / other / key
                    if file.exists():
                        found[file] = file.stat().st_mtime_ns
    return found


def run_round(folder: Path, reference: Path, plan: Plan, rng: random.Random) -> list[str]:
    """One kill, its resumes and the comparison. Returns what was wrong."""
    store = folder / "killed.zarr"
    first_run(store, plan, rng)
    done = marked_files(store)
    for _ in range(MAX_RESUMES):
        again = softclose(*run_arguments(store), *placement(plan))
        if again.returncode == 0:
            break
    else:
        return [f"{plan}: never finished: {again.stderr[-500:]}"]
    problems = [f"{plan}: {name}" for name in differences(reference, store)]
    rewritten = [file.relative_to(store) for file, when in done.items() if file.stat().st_mtime_ns != when]
    if rewritten:
        problems.append(f"{plan}: computed again: {rewritten[0]} and {len(rewritten) - 1} more")
    return problems


def make_reference(folder: Path) -> tuple[Path, float]:
    """An uninterrupted serial run: its store, and how long it took [s]."""
    started = time.monotonic()
    done = softclose(*run_arguments(folder / "reference.zarr"), "--serial")
    if done.returncode:
        raise RuntimeError(f"the reference run failed: {done.stderr}")
    return folder / "reference.zarr", time.monotonic() - started


def main() -> int:
    """Run the rounds and print a summary; exit code 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    wrong: list[str] = []
    kinds: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as scratch:
        reference, duration = make_reference(Path(scratch))
        print(f"reference: {duration:.1f} s; {options.rounds} rounds, seed {options.seed}", flush=True)
        for number in range(1, options.rounds + 1):
            plan = random_plan(rng, 1.5 * duration)
            kinds[plan.point or plan.kind] += 1
            with tempfile.TemporaryDirectory(dir=scratch) as folder:
                problems = run_round(Path(folder), reference, plan, rng)
            print(f"{number:4d} {plan}: {'equal' if not problems else 'WRONG'}", flush=True)
            wrong += problems
    print(f"{options.rounds} kills, {len(wrong)} differences: {dict(sorted(kinds.items()))}")
    for problem in wrong:
        print(problem)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
