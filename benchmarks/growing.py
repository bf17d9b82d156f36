"""Does a finishing stage that grows its ensembles end as well? Certified g and trajectories by seed. Prints a table.

python benchmarks/growing.py --seeds 1-10
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from softclose.propose.plan import plan
from softclose.propose.protocol import Problem
from softclose.settings import load_config
from softclose_workflows import api

DESCENTS = [
    "campaign.budget=0",
    "population.n_switches=256",
    "explore.budget=6400",
    "explore.n_descents=6",
    "finish.budget=808",
    "finish.n_switches=8192",
]
"""A preset's search by descents alone, as it was when this was measured."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--preset", default="current-three")
    parser.add_argument("--seeds", default="1-10", help="first-last")
    parser.add_argument("--switches", type=int, default=100_000)
    options = parser.parse_args()
    first, last = (int(v) for v in options.seeds.split("-"))
    found: dict[bool, list[float]] = {False: [], True: []}
    print("| seed | g, whole ensembles | g, growing ones | difference |\n| ---: | ---: | ---: | ---: |")
    for seed in range(first, last + 1):
        for grows in found:
            with tempfile.TemporaryDirectory() as folder:
                settings = [*DESCENTS, f"campaign.seed={seed}", f"finish.grows={str(grows).lower()}", "store.n_times=2"]
                run = api.run(options.preset, Path(folder) / "a.zarr", settings=settings)
                best = api.certify(run, n_switches=options.switches).value.best
                found[grows].append(best.assessment.g_cm_s)
        whole, growing = found[False][-1], found[True][-1]
        print(f"| {seed} | {whole:.2f} | {growing:.2f} | {growing - whole:+.2f} |", flush=True)
    difference = np.array(found[True]) - np.array(found[False])
    print(f"| median | {np.median(found[False]):.2f} | {np.median(found[True]):.2f} | {np.median(difference):+.2f} |")
    for grows in found:
        waves = plan(Problem(load_config(options.preset, [*DESCENTS, f"finish.grows={str(grows).lower()}"])))
        stages = dict.fromkeys(wave.stage for wave in waves)
        spent = {stage: sum(w.size * w.n_switches for w in waves if w.stage == stage) for stage in stages}
        print(f"trajectories, {'growing' if grows else 'whole'}: {sum(spent.values()):,} ({spent})")


if __name__ == "__main__":
    main()
