"""Do workers idle for lack of tasks? A device model that sleeps for 0.1 s a switch, and many workers.

python benchmarks/sleeping.py [--workers 32] [--switches 64] [--candidates 40] [--fresh 640]

It takes no processor time to speak of, so that a laptop may stand for a cluster: workers are threads of this process.
Busy is what the workers slept over workers times wall time, start-up apart. A campaign whose waves are known
beforehand (engine sobol), one whose waves wait for each other (cmaes), and a certification.
"""

from __future__ import annotations

import argparse
import tempfile
import threading
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import softclose
from softclose.settings import load_config
from softclose_store import DriverStore
from softclose_workflows.analyses.certify import certify
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.crew import Crew
from softclose_workflows.run.executors.threads import ThreadExecutor

SECONDS = 0.1
_slept, _lock = [0.0], threading.Lock()


def asleep(switches: Any, waveform: Any, **settings: Any) -> softclose.Responses:
    """Eqs. 1-2, slowly."""
    found = softclose.simulate(switches, waveform, **settings)
    time.sleep(SECONDS * len(found.status))
    with _lock:
        _slept[0] += SECONDS * len(found.status)
    return found


asleep.seconds_a_trajectory = SECONDS  # type: ignore[attr-defined]


def told(what: str, workers: int, wall: float) -> None:
    """One row of the table."""
    print(f"| {what} | {_slept[0] / SECONDS:,.0f} | {wall:.1f} | {_slept[0] / (workers * wall):.1%} |", flush=True)
    _slept[0] = 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=32)
    parser.add_argument("--switches", type=int, default=64)
    parser.add_argument("--candidates", type=int, default=40)
    parser.add_argument("--fresh", type=int, default=640)
    options = parser.parse_args()
    softclose.allow_code("sleeping:asleep")
    print("| work | trajectories | wall time, s | busy |\n| --- | ---: | ---: | ---: |")
    with tempfile.TemporaryDirectory() as folder:
        for engine in ("sobol", "cmaes"):
            config = load_config(
                "current",
                [
                    "model.name=sleeping:asleep",
                    f"optimiser.engine={engine}",
                    f"campaign.budget={options.candidates}",
                    f"population.n_switches={options.switches}",
                    "store.n_times=11",
                ],
            )
            path = str(Path(folder) / f"{engine}.zarr")
            create_store(config, path)
            executor = ThreadExecutor(options.workers)
            _slept[0] = 0.0
            with DriverStore(path) as store:
                driver = Driver(store, executor)
                driver.run()
            told(f"{engine}, blocks of {config.block_switches}", options.workers, driver.spent.wall)
        began = time.perf_counter()
        certify(path, n_switches=options.fresh, top=2, mapper=Crew(lambda: executor))
        told("certificate", options.workers, time.perf_counter() - began)
        executor.close()


if __name__ == "__main__":
    import_module("sleeping").main()  # by the name that the model has, so that there is one clock
