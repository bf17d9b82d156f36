"""What modes and losses cost the kernel, and what the second mode does to waveforms designed with and without it.

Rates: trajectories per second on one core, CPU time, median of the repeats, all cases in one run on distinct switches
of the current population, each with the largest error of V against rtol 1e-12. Worth: the best waveforms
of stores, found with one mode or with two, on the same fresh switches under both models.

    python benchmarks/modes.py [--switches 2000] [--repeats 5] [--fresh 20000] [STORE ...]
"""

from __future__ import annotations

import argparse
import math
import statistics
import time
from importlib import resources
from pathlib import Path

import numpy as np

from softclose import Losses, Pulse, ReducedOrder, Responses, Waveform, assess, load_population, simulate
from softclose.kernel.dispatch import ONE_MODE
from softclose.switch.reduced_order import read_reduced_order

HELD = Waveform([Pulse(0, 4.4, 7.25, 111.6), Pulse(56.5, 19, math.inf, 75)])


def plate() -> ReducedOrder:
    """The published plate's two modes."""
    with resources.as_file(resources.files("softclose.presets") / "modes" / "plate.toml") as path:
        return read_reduced_order(path)


def rates(n: int, repeats: int) -> None:
    cases: dict[str, dict[str, object]] = {
        "Eqs. 1-2, Taylor kernel": {},
        "one mode, no losses": {"modes": ONE_MODE},
        "one mode, Q 20": {"losses": Losses(quality_factor=20.0)},
        "one mode, film of 2 µPa s": {"losses": Losses(film_viscosity_uPa_s=2.0)},
        "two modes": {"modes": plate()},
    }
    print(f"{'case':28s} {'rtol':>6s} {'trajectories/s':>15s} {'of Taylor':>10s} {'error of V [µm/µs]':>20s}")
    for rtol in (1e-9, 1e-7):
        first = math.nan
        for name, settings in cases.items():
            spent, error = [], 0.0
            for r in range(repeats):
                switches = load_population("current").sample(n, seed=100 + r)
                begin = time.process_time()
                found = simulate(switches, HELD, rtol=rtol, **settings)  # type: ignore[arg-type]
                spent.append(time.process_time() - begin)
                if r == 0:
                    few = switches[:200]
                    best = simulate(few, HELD, rtol=1e-12, **settings)  # type: ignore[arg-type]
                    error = float(np.nanmax(np.abs(found.max_contact_speed[:200] - best.max_contact_speed)))
            rate = n / statistics.median(spent[1:] or spent)
            first = rate if math.isnan(first) else first
            print(f"{name:28s} {rtol:6.0e} {rate:15,.0f} {rate / first:10.3f} {error:20.1e}")


def worth(stores: list[str], n: int) -> None:
    from softclose_workflows.api import open_run

    switches = load_population("current").sample(n, seed=77)
    for store in stores:
        waveform = open_run(store).waveform
        for name, modes in (("one mode", None), ("two modes", plate())):
            found: Responses = simulate(switches, waveform, modes=modes, rtol=1e-8)
            a = assess(found)
            peaks = "" if found.mode_peak_um is None else f", mode 2 up to {found.mode_peak_um[:, 1].mean():.3f} µm"
            lower, upper = a.g_interval
            print(
                f"{Path(store).stem:16s} under {name:9s}: g {a.g_cm_s:.2f} ({lower:.2f}-{upper:.2f}), "
                f"v_u {a.v_u_cm_s:.2f}, p_nc {a.p_nc:.4f}{peaks}"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stores", nargs="*", help="stores whose best waveforms are judged under both models")
    parser.add_argument("--switches", type=int, default=2000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--fresh", type=int, default=20_000)
    given = parser.parse_args()
    rates(given.switches, given.repeats)
    worth(given.stores, given.fresh)
