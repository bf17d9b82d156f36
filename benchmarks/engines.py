"""Engines on one problem, several seeds: g after n evaluations (median, spread) and time. Prints one table.

python benchmarks/engines.py --space three-pulse-full --budget 200 --seeds 101-110 skopt cmaes direct sobol
"""

from __future__ import annotations

import argparse

import numpy as np

from softclose.propose.side_by_side import compare_engines
from softclose.settings import load_config


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("engines", nargs="+")
    parser.add_argument("--space", default="two-pulse-full")
    parser.add_argument("--population", default="current")
    parser.add_argument("--budget", type=int, default=150)
    parser.add_argument("--n-switches", type=int, default=200)
    parser.add_argument("--sampling", default="sobol", choices=["sobol", "monte-carlo"])
    parser.add_argument("--seeds", default="101-105", help="first-last")
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.KEY=VALUE")
    options = parser.parse_args()
    config = load_config(
        {
            "campaign": {"budget": options.budget},
            "population": {
                "name": options.population,
                "n_switches": options.n_switches,
                "sampling": options.sampling,
            },
            "waveform": {"space": options.space},
        },
        options.set,
    )
    first, last = (int(v) for v in options.seeds.split("-"))
    marks = [n for n in (20, 50, 100, 150, 200, 300, 500, 1000) if n <= config.total_budget]
    print(f"{options.space}, {options.population}, N = {options.n_switches} {options.sampling}, seeds {options.seeds}")
    heads = ["engine", *(f"at {n}" for n in marks), "final of each seed", "s a run", "slowest proposal, s"]
    print("| " + " | ".join(heads) + " |")
    print("| --- " * (len(marks) + 4) + "|")
    for engine in options.engines:
        runs = list(compare_engines(config, [engine], range(first, last + 1)))
        best = np.array([r.best_g_cm_s for r in runs])
        cells = [
            f"{np.median(best[:, n - 1]):.1f} ({best[:, n - 1].min():.1f}–{best[:, n - 1].max():.1f})" for n in marks
        ]
        finals = " ".join(f"{g:.2f}" for g in np.sort(best[:, -1]))
        wall = float(np.median([r.wall_s[-1] for r in runs]))
        slowest = max(float(r.propose_s.max()) for r in runs)
        print(f"| {engine} | " + " | ".join(cells) + f" | {finals} | {wall:.0f} | {slowest:.2f} |", flush=True)


if __name__ == "__main__":
    main()
