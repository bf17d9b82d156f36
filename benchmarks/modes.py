"""What the second mode does to waveforms designed with and without it (what it costs: `benchmarks/kinds.py`).

The best waveforms of stores, found with one mode or with two, on the same fresh switches under both models.

    python benchmarks/modes.py [--fresh 20000] STORE ...
"""

from __future__ import annotations

import argparse
from importlib import resources
from pathlib import Path

from softclose import ReducedOrder, Responses, assess, load_population, simulate
from softclose.switch.reduced_order import read_reduced_order


def plate() -> ReducedOrder:
    """The published plate's two modes."""
    with resources.as_file(resources.files("softclose.presets") / "modes" / "plate.toml") as path:
        return read_reduced_order(path)


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
    parser.add_argument("stores", nargs="+", help="stores whose best waveforms are judged under both models")
    parser.add_argument("--fresh", type=int, default=20_000)
    given = parser.parse_args()
    worth(given.stores, given.fresh)
