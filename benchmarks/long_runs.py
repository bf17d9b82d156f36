"""Do long runs stay flat? Time a candidate, and memory of driver and workers, over a whole run. Prints tables.

python benchmarks/long_runs.py --candidates 10000 --switches 1000000 --campaigns 200
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import psutil

from softclose.settings import CampaignConfig, load_config
from softclose_store import DriverStore
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.executors import Placement, open_executor
from softclose_workflows.studies.series import Effort, Member, run_series

PLAIN = ("optimiser.engine=sobol", "explore.budget=0", "finish.budget=0", "store.n_times=2")


def _memory() -> tuple[float, float]:
    """MB of this process, and of the largest of its workers."""
    own = psutil.Process()
    workers = [0.0]
    for child in own.children(recursive=True):
        try:
            workers.append(child.memory_info().rss / 1e6)
        except psutil.Error:
            continue
    return own.memory_info().rss / 1e6, max(workers)


def campaign(config: CampaignConfig, parts: int) -> None:
    """One campaign; a line for each part of it."""
    n = config.total_budget
    marks = [n * (k + 1) // parts for k in range(parts)]
    with tempfile.TemporaryDirectory() as folder, open_executor(Placement()) as executor:
        path = str(Path(folder) / "a.zarr")
        create_store(config, path)
        with DriverStore(path) as store:
            commit, before = store.commit, [0, time.perf_counter()]

            def committed(*a: object, **k: object) -> None:
                commit(*a, **k)  # type: ignore[arg-type]
                if marks and store.n_committed >= marks[0]:
                    marks.pop(0)
                    now = time.perf_counter()
                    each = 1e3 * (now - before[1]) / (store.n_committed - before[0])
                    driver, worker = _memory()
                    print(f"| {store.n_committed:,} | {each:.1f} | {driver:.0f} | {worker:.0f} |", flush=True)
                    before[:] = [store.n_committed, now]

            store.commit = committed  # type: ignore[method-assign]
            Driver(store, executor).run()


def study(n: int, parts: int) -> None:
    """A study of n campaigns of twenty candidates; a line for each part of it."""
    settings = (*PLAIN, "campaign.budget=20", "population.n_switches=200")
    members = [
        Member(name=f"seed-{seed}", config=load_config("current", [*settings, f"campaign.seed={seed}"]))
        for seed in range(1, n + 1)
    ]
    before, count = time.perf_counter(), 0

    def done(*_: object) -> None:
        nonlocal before, count
        count += 1
        if count % (n // parts) == 0:
            now = time.perf_counter()
            driver, worker = _memory()
            each = 1e3 * (now - before) / (n // parts)
            print(f"| {count:,} | {each:.0f} | {driver:.0f} | {worker:.0f} |", flush=True)
            before = now

    with tempfile.TemporaryDirectory() as folder:
        run_series(members, folder, Effort(n_switches=1000, top=2, quiet=True), done)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--candidates", type=int, default=10_000)
    parser.add_argument("--switches", type=int, default=1_000_000)
    parser.add_argument("--campaigns", type=int, default=200)
    options = parser.parse_args()
    head = "ms a {} | driver, MB | worker, MB |\n| ---: | ---: | ---: | ---: |"
    if options.candidates:
        print("| candidates | " + head.format("candidate"))
        small = (f"campaign.budget={options.candidates}", "population.n_switches=500")
        campaign(load_config("current", [*PLAIN, *small]), 10)
    if options.switches:
        print(f"\n| candidates of {options.switches:,} switches | " + head.format("candidate"))
        large = ("campaign.budget=60", f"population.n_switches={options.switches}")
        campaign(load_config("current", [*PLAIN, *large]), 3)
    if options.campaigns:
        print("\n| campaigns of a study | " + head.format("campaign"))
        study(options.campaigns, 10)


if __name__ == "__main__":
    main()
