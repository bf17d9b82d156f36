"""What measuring each switch is worth: certified g of campaigns by what is measured, several seeds. Prints a table.

python benchmarks/trim.py --seeds 1-4
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from softclose_workflows import api

CASES = {
    "nothing": ["trim.measured=nothing"],
    "pull-in to 1 %, volts only": ["trim.measured=pull-in", "trim.scaled=voltage"],
    "pull-in to 1 %": ["trim.measured=pull-in"],
    "pull-in and resonance to 1 %": [],
    "both to 1 %, limits not kept": ["trim.keep_limits=false"],
    "both to 2 %": ["trim.pull_in_error=0.02", "trim.resonance_error=0.02"],
    "pull-in to 1 %, 8 bins": ["trim.measured=pull-in", "trim.bins=8"],
}
"""Changes of the preset `current-trim`: three pulses, both to 1 %, limits kept."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1-4", help="first-last")
    parser.add_argument("cases", nargs="*", help="words in the names of cases; all where left out")
    parser.add_argument("--switches", type=int, default=100_000)
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.KEY=VALUE")
    options = parser.parse_args()
    first, last = (int(v) for v in options.seeds.split("-"))
    print("| measured | g of each seed [cm/s] | v_u | p_nc | largest peak [V] |\n| --- | --- | --- | --- | --- |")
    for case, settings in CASES.items():
        if options.cases and not any(word in case for word in options.cases):
            continue
        rows = []
        for seed in range(first, last + 1):
            with tempfile.TemporaryDirectory() as folder:  # a gigabyte each
                settings_of_seed = [*settings, f"campaign.seed={seed}", "store.n_times=2", *options.set]
                run = api.run("current-trim", Path(folder) / "trim.zarr", settings=settings_of_seed)
                best = api.certify(run, n_switches=options.switches).value.best
            a = best.assessment
            rows.append((a.g_cm_s, a.v_u_cm_s, a.p_nc, best.waveform.max_voltage()))
        g, v_u, p_nc, peak = np.array(sorted(rows)).T
        cells = [" ".join(f"{x:{form}}" for x in xs) for xs, form in ((g, ".2f"), (v_u, ".2f"), (p_nc, ".3f"))]
        print(f"| {case} | {' | '.join(cells)} | {peak.max():.0f} |", flush=True)


if __name__ == "__main__":
    main()
