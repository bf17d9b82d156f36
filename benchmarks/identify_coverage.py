"""How often do the intervals of `calibrate --of` hold the truth? Synthetic readings with errors of the stated size.

python benchmarks/identify_coverage.py --repetitions 400
python benchmarks/identify_coverage.py --repetitions 300 --cases 2 4
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace

import numpy as np

from softclose.device.device import Device
from softclose.identify.least_squares import identify
from softclose.identify.model import Model, predicted
from softclose.identify.readings import Dynamics, Reading, ReadingKind
from softclose.switch.losses import Losses

SWITCH = np.array([2.4, 3.7, 97.0, 6.2])
VOLTS = (103.0, 108.0, 115.0, 130.0, 150.0)
CASES: dict[str, tuple[Losses, dict[str, float], tuple[ReadingKind, ...], tuple[ReadingKind, ...]]] = {
    "closing, second contact, pull-in, resonance": (
        Losses(),
        {"M": 7.1, "force": 1.1, "restitution": 0.6},
        ("closing", "second contact"),
        ("pull-in", "resonance"),
    ),
    "closing and pull-in": (Losses(), {"M": 7.1, "force": 1.1}, ("closing",), ("pull-in",)),
    "closing, second contact, pull-in, of a damped switch": (
        Losses(quality_factor=3.0),
        {"M": 7.1, "force": 1.1, "Q": 3.6, "restitution": 0.6},
        ("closing", "second contact"),
        ("pull-in",),
    ),
    "one of each": (Losses(), {"M": 7.1, "force": 1.1}, (), ("pull-in", "resonance")),
}
"""Losses, what is true and fitted, what is measured at each voltage, what is measured once."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=400)
    parser.add_argument("--cases", type=int, nargs="+", choices=range(1, len(CASES) + 1), help="which of them [all]")
    chosen = parser.parse_args()
    n = chosen.repetitions
    for i, (name, (losses, truth, steps, static)) in enumerate(CASES.items(), start=1):
        if chosen.cases and i not in chosen.cases:
            continue
        device = Device(
            name="single-mode",
            horizon_us=200.0,
            restitution=0.5,
            plate_area_um2=16_700.0,
            rtol=1e-9,
            method="taylor",
            losses=losses,
        )
        begun = Model(switch=SWITCH, device=device)
        asked = [Reading(kind=kind, value=40.0, volts=u) for kind in steps for u in VOLTS]
        asked += [Reading(kind=kind, value=1.0) for kind in static]
        said = predicted(*begun.at(truth), tuple(asked))
        held = {p: None for p in begun.values() if p not in truth}
        hits = dict.fromkeys(truth, 0)
        open_ones = dict.fromkeys(truth, 0)
        for seed in range(n):
            z = np.random.default_rng(seed).standard_normal(len(asked))
            readings = tuple(
                replace(r, value=s * math.exp(r.weighed * e)) for r, s, e in zip(asked, said, z, strict=True)
            )
            found = identify(begun, Dynamics(readings=readings), fixed=held, n_starts=1)
            for p, value in truth.items():
                low, high = found.parameters[p].interval
                hits[p] += low <= value <= high
                open_ones[p] += math.isinf(high)
            if (seed + 1) % 500 == 0:
                print(f"{seed + 1} of {n}: {hits}, not told {open_ones}", file=sys.stderr, flush=True)
        cells = ", ".join(
            f"{p} {hits[p] / n:.3f}" + (f" ({open_ones[p]} not told)" if open_ones[p] else "") for p in truth
        )
        print(f"{name}: {len(asked)} readings, {n} repetitions, {cells}", flush=True)


if __name__ == "__main__":
    main()
