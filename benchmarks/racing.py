"""Does a race find the best candidate on fewer switches? Beside certifying all of them in full. Prints a table.

python benchmarks/racing.py --seeds 1-10
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from softclose_workflows import api
from softclose_workflows.analyses.certify import certify
from softclose_workflows.analyses.finalists import certify_within
from softclose_workflows.run.crew import open_crew
from softclose_workflows.run.executors import Placement


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--preset", default="current-three")
    parser.add_argument("--seeds", default="1-10", help="first-last")
    parser.add_argument("--switches", type=int, default=100_000)
    parser.add_argument("--top", type=int, default=10)
    parser.add_argument("--within", type=float, default=0.05)
    options = parser.parse_args()
    first, last = (int(v) for v in options.seeds.split("-"))
    size: dict[str, Any] = {"n_switches": options.switches, "top": options.top}
    print("| seed | best in full | best of the race | loses | its margin | switches | trajectories |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    spent = []
    for seed in range(first, last + 1):
        with tempfile.TemporaryDirectory() as folder:
            settings = [f"campaign.seed={seed}", "finish.grows=true", "store.n_times=2"]
            store = api.run(options.preset, Path(folder) / "a.zarr", settings=settings).store
            other = shutil.copytree(store, Path(folder) / "b.zarr")
            with open_crew(Placement()) as crew:
                full = certify(store, **size, mapper=crew)
                _, race = certify_within(str(other), options.within, **size, mapper=crew)
            lap = race.laps[-1]
            g = {d.candidate: d.assessment.g_cm_s for d in full.candidates}
            share = race.trajectories / (options.switches * len(full.candidates))
            spent.append(share)
            print(
                f"| {seed} | {full.best.candidate} | {lap.best} | {g[lap.best] - full.best.assessment.g_cm_s:.3f} | "
                f"{lap.margin_cm_s:.3f} | {lap.n_switches:,} | {share:.0%} |",
                flush=True,
            )
    print(f"| median | | | | | | {np.median(spent):.0%} |")


if __name__ == "__main__":
    main()
