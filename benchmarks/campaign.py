"""What a whole campaign costs: in process, on workers, against version 0.1, against a page of one's own.

    python benchmarks/campaign.py [--cases exploration default large] [--workers 0 1 2] [--repeats 3]
    python benchmarks/campaign.py --old ../softclose-0.1      beside a checkout of version 0.1 (tag or commit 6fc4e64)
    python benchmarks/campaign.py --by-hand                   beside cma + kernel + joblib, with and without npz files
    python benchmarks/campaign.py --sleep 2 8 32              scheduling alone: a device model that sleeps 0.1 s
    python benchmarks/campaign.py --cases million             one candidate of a million switches: memory

Every measurement is a process of its own. The contestants take turns, so that a drifting machine disturbs all alike,
and ratios are taken within a turn. Workers 0 is the serial executor. Medians of the turns are printed.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve()
ROOT = HERE.parents[1]

CASES: dict[str, tuple[str, tuple[str, ...]]] = {
    "exploration": (
        "current-three",
        ("campaign.budget=0", "population.n_switches=256", "explore.budget=3200", "explore.n_descents=6"),
    ),
    "default": (
        "current-three",
        (
            "optimiser.engine=sobol",
            "campaign.wave=40",
            "campaign.budget=80",
            "explore.budget=0",
            "finish.budget=0",
            "population.n_switches=2000",
            "store.n_times=1001",
            "store.max_impacts=64",
        ),
    ),
    "large": (
        "current-three",
        (
            "optimiser.engine=sobol",
            "campaign.wave=8",
            "campaign.budget=16",
            "explore.budget=0",
            "finish.budget=0",
            "population.n_switches=20000",
            "store.n_times=1001",
            "store.max_impacts=64",
        ),
    ),
    "million": (
        "current-three",
        (
            "optimiser.engine=sobol",
            "campaign.budget=2",
            "explore.budget=0",
            "finish.budget=0",
            "population.n_switches=1000000",
            "store.n_times=1001",
            "store.max_impacts=64",
        ),
    ),
    "as-0.1": (
        "current-three",
        (
            "campaign.budget=200",
            "prior.model=none",
            "population.n_switches=256",
            "explore.budget=3000",
            "explore.n_descents=4",
            "finish.budget=300",
            "finish.n_switches=4096",
        ),
    ),
    "whole": ("current-three", ()),
}
"""Name -> preset and overrides. `as-0.1` is the work of version 0.1's preset, `whole` the preset as it ships."""

OLD = {
    "exploration": ("campaign.budget=20", "optimiser.engine=sobol", "finish.budget=960", "finish.explore=960"),
    "as-0.1": (),
}
"""The same work in the words of version 0.1, where it can be said: fewer candidates, since each costs 0.1 s."""


def measure(case: str, workers: int, folder: Path) -> dict[str, float]:
    """One campaign in this process and its workers. Times in s, from the ready executor to the last commit."""
    from softclose import load_config
    from softclose_store import DriverStore
    from softclose_workflows.run.campaign import Driver
    from softclose_workflows.run.creation import create_store
    from softclose_workflows.run.executors import Placement, open_executor
    from softclose_workflows.run.executors.dask import DaskExecutor

    preset, settings = CASES[case]
    config = load_config(preset, settings)
    path = folder / "campaign.zarr"
    placement = Placement(workers=workers) if workers else Placement(serial=True)
    with open_executor(placement) as executor:
        warm_up(executor, folder)
        create_store(config, str(path))
        with DriverStore(str(path)) as store:
            driver = Driver(store, executor)
            began, cpu = time.perf_counter(), time.process_time()
            driver.run()
            wall, own = time.perf_counter() - began, time.process_time() - cpu
        peaks = executor._client.run(peak_MB).values() if isinstance(executor, DaskExecutor) else (0.0,)
    n, spent = config.total_budget, driver.spent
    files = [f for f in path.rglob("*") if f.is_file()]
    working = own - spent.simulate - spent.store if not workers else own
    return {
        "wall_s": wall,
        "candidates_per_s": n / wall,
        "kernel_share": spent.simulate / (max(workers, 1) * wall),
        "store_share": spent.store / (max(workers, 1) * wall),
        "propose_ms": 1e3 * spent.propose / n,
        "dispatch_ms": 1e3 * spent.dispatch / n,
        "assess_ms": 1e3 * spent.assess / n,
        "commit_ms": 1e3 * spent.commit / n,
        "driver_cpu_ms": 1e3 * working / n,
        "files_per_candidate": len(files) / n,
        "bytes_per_candidate": sum(f.stat().st_size for f in files) / n,
        "peak_MB": peak_MB(),
        "peak_worker_MB": max(peaks),
    }


def peak_MB() -> float:
    """The largest resident set of this process so far; workers say theirs, since they are no children of the driver."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def warm_up(executor: Any, folder: Path) -> None:
    """Imports and compiled code on every worker, which a campaign pays once."""
    from softclose import load_config
    from softclose_store import DriverStore
    from softclose_workflows.run.campaign import Driver
    from softclose_workflows.run.creation import create_store

    path = folder / "warm.zarr"
    settings = (
        "optimiser.engine=sobol",
        "campaign.wave=16",
        "campaign.budget=16",
        "explore.budget=0",
        "finish.budget=0",
        "compute.block_switches=256",
    )
    create_store(load_config("current-three", settings), str(path))
    with DriverStore(str(path)) as store:
        Driver(store, executor).run()
    shutil.rmtree(path)


def measure_old(case: str, workers: int, checkout: Path, folder: Path) -> dict[str, float]:
    """The same case by version 0.1, as its command runs it; start-up of the cluster included, some 3 s."""
    settings = [word for s in OLD[case] for word in ("--set", s)]
    where = ["--workers", str(workers)] if workers else ["--serial"]
    path = folder / "old.zarr"
    env = os.environ | {"PYTHONPATH": ":".join(str(checkout / p) for p in ("pipeline", "store", "workflows"))}
    began = time.perf_counter()
    subprocess.run(
        [
            sys.executable,
            "-m",
            "softclose_workflows",
            "run",
            "current-three",
            "--store",
            str(path),
            "--quiet",
            *where,
            *settings,
        ],
        env=env,
        check=True,
        stdout=subprocess.DEVNULL,
    )
    wall = time.perf_counter() - began
    files = [f for f in path.rglob("*") if f.is_file()]
    n = int(json.loads((path / "zarr.json").read_text())["attributes"]["n_committed"])
    return {
        "wall_s": wall,
        "candidates_per_s": n / wall,
        "files_per_candidate": len(files) / n,
        "bytes_per_candidate": sum(f.stat().st_size for f in files) / n,
    }


def measure_by_hand(files: bool, workers: int, folder: Path) -> dict[str, float]:
    """What a user would write: four CMA-ES descents, the kernel, joblib, perhaps an npz a candidate. 960 candidates."""
    import cma
    import joblib
    import numpy as np

    from softclose import load_config
    from softclose.propose.protocol import Problem

    config = load_config("current-three")
    problem = Problem(config)
    switches = problem.population.sample(256, seed=1, sampling="sobol")
    rng = np.random.default_rng(1)
    descents = [
        cma.CMAEvolutionStrategy(
            rng.random(problem.space.dim), 0.12, {"bounds": [0, 1], "popsize": 20, "verbose": -9, "seed": k + 1}
        )
        for k in range(4)
    ]
    with joblib.Parallel(n_jobs=max(workers, 1)) as pool:
        pool(joblib.delayed(by_hand)(problem.space.waveform(rng.random(10)), switches, "") for _ in range(8))
        began = time.perf_counter()
        done = 0
        while done < 960:
            points = [(d, x) for d in descents for x in d.ask()]
            names = [str(folder / f"{done + i}.npz") if files else "" for i in range(len(points))]
            g = pool(
                joblib.delayed(by_hand)(problem.space.waveform(x), switches, name)
                for (_, x), name in zip(points, names, strict=True)
            )
            for k, d in enumerate(descents):
                d.tell([x for e, x in points if e is d], g[20 * k : 20 * k + 20])
            done += len(points)
        wall = time.perf_counter() - began
    stored = [f for f in folder.rglob("*.npz")]
    return {
        "wall_s": wall,
        "candidates_per_s": 960 / wall,
        "files_per_candidate": len(stored) / 960,
        "bytes_per_candidate": sum(f.stat().st_size for f in stored) / 960,
    }


def by_hand(waveform: Any, switches: Any, file: str) -> float:
    """Simulate, keep, and judge one candidate."""
    import numpy as np

    from softclose import assess, simulate

    response = simulate(switches, waveform, times_us=np.linspace(0, 250, 101), max_impacts=32, dtype=np.float32)
    if file:
        np.savez(
            file,
            x=response.x,
            v=response.v,
            speed=response.max_contact_speed,
            closed=response.closed,
            time=response.impact_time_us,
            impact=response.impact_speed,
        )
    return assess(response).g_cm_s


SLEEPER = """
import time
import numpy as np
from softclose import Responses

def sleeper(switches, waveform, *, max_impacts=0, times_us=None, dtype=np.float64, **settings):
    time.sleep(0.1)
    n = len(switches)
    speed = np.full(n, 0.1 + 1e-3 * waveform.pulses[0].volts / 150.0)
    return Responses(
        max_contact_speed=speed, first_contact_us=np.full(n, 50.0), closed=np.ones(n, dtype=bool),
        settling_us=np.full(n, 60.0), n_impacts=np.ones(n, dtype=np.int32), final_x=np.full(n, 2.4),
        final_v=np.zeros(n), status=np.zeros(n, dtype=np.int8),
        impact_time_us=np.full((n, max_impacts), np.nan), impact_speed=np.full((n, max_impacts), np.nan),
        times_us=times_us, x=np.zeros((n, len(times_us)), dtype=dtype), v=np.zeros((n, len(times_us)), dtype=dtype),
    )
"""


def install_sleeper(folder: Path) -> None:
    """A device model that sleeps, as an installed entry point: a folder for PYTHONPATH."""
    (folder / "sleeper.py").write_text(SLEEPER)
    about = folder / "sleeper-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: sleeper\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[softclose.models]\nsleeper = sleeper:sleeper\n")


def measure_sleep(workers: int, folder: Path) -> dict[str, float]:
    """Waves of eight tasks of 0.1 s a worker: the share of worker time spent asleep, which is the useful time here."""
    CASES["sleep"] = (
        "current-three",
        (
            "model.name=sleeper",
            "optimiser.engine=sobol",
            f"campaign.wave={8 * workers}",
            f"campaign.budget={32 * workers}",
            "campaign.lag=2",
            "explore.budget=0",
            "finish.budget=0",
            "population.n_switches=8",
            "compute.block_switches=8",
            "store.n_times=2",
            "store.max_impacts=1",
        ),
    )
    return measure("sleep", workers, folder)


def alone(*arguments: str, env: dict[str, str] | None = None) -> dict[str, float]:
    """One measurement in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, str(HERE), "--one", *arguments, "--folder", folder],
            env=os.environ | (env or {}),
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def one(arguments: argparse.Namespace) -> dict[str, float]:
    """What `alone` asked for."""
    what, *rest = arguments.one
    folder = Path(arguments.folder)
    if what == "old":
        return measure_old(rest[0], int(rest[1]), Path(rest[2]), folder)
    if what == "hand":
        return measure_by_hand(rest[0] == "files", int(rest[1]), folder)
    if what == "sleep":
        return measure_sleep(int(rest[0]), folder)
    return measure(what, int(rest[0]), folder)


def show(title: str, contestants: dict[str, Callable[[], dict[str, float]]], repeats: int) -> None:
    """Run the contestants in turns; print medians, and walls as ratios to the first within each turn."""
    turns: dict[str, list[dict[str, float]]] = {name: [] for name in contestants}
    for _ in range(repeats):
        for name, run in contestants.items():
            turns[name].append(run())
    first = next(iter(contestants))
    print(f"\n## {title} ({repeats} turns)\n")
    columns = list(dict.fromkeys(key for runs in turns.values() for key in runs[0]))
    print("| | times as fast | " + " | ".join(columns) + " |")
    print("| --- |" + " ---: |" * (len(columns) + 1))
    for name, runs in turns.items():
        ratio = statistics.median(a["wall_s"] / b["wall_s"] for a, b in zip(turns[first], runs, strict=True))
        cells = [f"{statistics.median(r[c] for r in runs):.3g}" if c in runs[0] else "–" for c in columns]
        print(f"| {name} | {ratio:.2f} | " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    """Parse, run, print Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="*", choices=list(CASES), default=["exploration", "default", "large"])
    parser.add_argument("--workers", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--old", metavar="CHECKOUT", help="a checkout of version 0.1")
    parser.add_argument("--by-hand", action="store_true")
    parser.add_argument("--sleep", nargs="*", type=int, default=[])
    parser.add_argument("--one", nargs="+", help=argparse.SUPPRESS)
    parser.add_argument("--folder", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(one(arguments)))
        return
    os.environ.setdefault("PYTHONPATH", ":".join(str(ROOT / p) for p in ("pipeline", "store", "workflows")))
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"
    for case in arguments.cases:
        contestants: dict[str, Callable[[], dict[str, float]]] = {}
        for workers in arguments.workers:
            name = f"{workers} workers" if workers else "in process"
            contestants[name] = lambda c=case, w=workers: alone(c, str(w))
            if arguments.old and case in OLD:
                contestants[f"0.1, {name}"] = lambda c=case, w=workers: alone("old", c, str(w), arguments.old)
            if arguments.by_hand and case == "exploration":
                for files in ("files", "none"):
                    contestants[f"by hand, {files}, {name}"] = lambda f=files, w=workers: alone("hand", f, str(w))
        show(case, contestants, arguments.repeats)
    if arguments.sleep:
        with tempfile.TemporaryDirectory() as folder:
            install_sleeper(Path(folder))
            env = {"PYTHONPATH": f"{os.environ['PYTHONPATH']}:{folder}"}
            runs = {f"{w} workers": lambda w=w: alone("sleep", str(w), env=env) for w in arguments.sleep}
            show("a device model that sleeps", runs, arguments.repeats)


if __name__ == "__main__":
    main()
