"""What a trajectory of every preset costs: trajectories per second and core, steps, cycles a step, share of the peak.

Every preset's lot and conditions under one drive, its deterministic design (where it has none, a step of its reference
voltage); trajectories are counted, so that a lot at its worst of three temperatures has three a switch. All in one run
and in turns, CPU time, median of the repeats. Steps are counted exactly, on the first switches: the least `max_steps`
with which one is integrated to its end. Operations are those of the generated series and of what reads it, once a step,
as under a voltage that changes: at constant voltage they are fewer. What a core can do at most, independent
multiply-adds in vectors, is measured in the same run, and so is its clock, by operations that wait for one another.

    python benchmarks/presets.py [--switches 4000] [--repeats 7] [--counted 40] [--only PRESET ...]
"""

from __future__ import annotations

import argparse
import ast
import math
import os
import statistics
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from softclose import Waveform, load_config
from softclose.baselines import BaselineError, deterministic_design, unshaped
from softclose.evaluate import draw
from softclose.evaluate.chain import chain_of
from softclose.evaluate.respond import respond_each
from softclose.kernel import dispatch, series, two_modes
from softclose.kernel.taylor import WORK_LIMIT
from softclose.population.lot import Lot
from softclose.presets import preset_names
from softclose.settings import CampaignConfig

FloatArray = NDArray[np.float64]
READERS = ("evaluate", "bend")
LANES = 64


@njit(fastmath={"contract"}, error_model="numpy")
def _products(lanes: FloatArray, n: int) -> None:
    for _ in range(n):
        for j in range(LANES):
            lanes[j] = lanes[j] * 0.999999 + 1e-9


@njit(error_model="numpy")
def _chain(x: np.uint64, n: int) -> np.uint64:
    for _ in range(n):
        x ^= x << np.uint64(13)
        x ^= x >> np.uint64(7)
        x ^= x << np.uint64(17)
    return x


def _best(run: Callable[[], object]) -> float:
    """Shortest of many runs [s]: on a shared core some are let through whole."""
    found = math.inf
    for _ in range(300):
        begin = time.perf_counter()
        run()
        found = min(found, time.perf_counter() - begin)
    return found


def peak_flops() -> float:
    """Multiply-adds of one core that depend on nothing, each as two operations, per second."""
    lanes = np.ones(LANES)
    _products(lanes, 1)
    return 2.0 * LANES * 2e4 / _best(lambda: _products(lanes, 20_000))


def clock_hz() -> float:
    """Of shifts and exclusive ors that wait for one another, a cycle each on every processor."""
    seed = np.uint64(88172645463325252)
    _chain(seed, 1)
    return 6.0 * 5e4 / _best(lambda: _chain(seed, 50_000))


@cache
def operations() -> dict[str, int]:
    """Generated function -> its additions, multiplications and divisions."""
    found = {}
    for path in sorted(Path(series.__file__).parent.glob("*series.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef):
                found[node.name] = sum(isinstance(n, ast.BinOp | ast.AugAssign) for n in ast.walk(node))
    return found


def series_of(config: CampaignConfig) -> str:
    """Name of the series under a voltage that changes; "" where the kernel is Runge-Kutta's."""
    chain = chain_of(config)
    losses, modes = chain.device.losses, chain.device.modes
    film = bool(np.any(losses.film_viscosity_uPa_s))
    if not dispatch.in_series(modes, losses):
        return ""
    if modes is not None and len(modes.mode) == two_modes.N_MODES:
        return "two_film" if film else "two"
    if modes is not None or losses.slips:
        kind = "table" if modes is not None and modes.capacitance is not None else "shaped"
        return f"{kind}_film_driven" if film else f"{kind}_driven"
    if losses.moving:
        return "film_driven" if film else "damped_driven"
    return "flight_driven"


def drive_of(config: CampaignConfig) -> Waveform:
    """Two pulses that land the mean switch; a step where there are none."""
    try:
        return deterministic_design(
            config.build_population(),
            max_volts=config.waveform.max_volts,
            rise_us=config.waveform.min_rise_us,
            horizon_us=config.model.horizon_us,
            device=chain_of(config).device,
        )
    except BaselineError:
        return unshaped(config.reference.step_volts)


def steps(config: CampaignConfig, lot: Lot, drive: Waveform) -> float:
    """Steps of a trajectory, mean over the lot: of each switch the least limit under which it is not cut short."""

    def cut(limit: int) -> NDArray[np.bool_]:
        return np.concatenate([r.status == WORK_LIMIT for r in respond_each(config, lot, drive, max_steps=limit)])

    low = np.zeros(len(cut(1)), dtype=np.int64)
    high = np.full(len(low), 1 << 13)
    while (high - low > 1).any():
        middle = (low + high) // 2
        for limit in np.unique(middle[high - low > 1]):
            asked = (middle == limit) & (high - low > 1)
            failed = cut(int(limit))
            low = np.where(asked & failed, limit, low)
            high = np.where(asked & ~failed, limit, high)
    return float(high.mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--switches", type=int, default=4000)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--counted", type=int, default=40)
    parser.add_argument("--only", nargs="*", help="presets, in the place of all")
    args = parser.parse_args()
    work: dict[str, tuple[CampaignConfig, Lot, Waveform]] = {}
    for name in args.only or preset_names():
        config = load_config(name)
        work[name] = config, draw(config, args.switches, seed=7), drive_of(config)
        respond_each(config, draw(config, 1, seed=7), work[name][2])  # compiles
    spent: dict[str, list[float]] = {name: [] for name in work}
    n_cases: dict[str, int] = {}
    peaks, clocks = [], []
    for _ in range(args.repeats):
        peaks.append(peak_flops())
        clocks.append(clock_hz())
        for name, (config, lot, drive) in work.items():
            begin = time.process_time()
            n_cases[name] = len(respond_each(config, lot, drive))
            spent[name].append(time.process_time() - begin)
    peak, clock = max(peaks), max(clocks)
    print(f"load {os.getloadavg()[0]:.1f}; a core: {peak / 1e9:.1f} Gflop/s, {clock / 1e9:.2f} GHz")
    print("| preset | trajectories/s | steps | cycles a step | Mflop/s | share of the peak |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    counts = operations()
    for name, (config, _lot, drive) in work.items():
        rate = args.switches * n_cases[name] / statistics.median(spent[name])
        n = steps(config, draw(config, args.counted, seed=7), drive)
        kind = series_of(config)
        flops = rate * n * (counts[kind] + sum(counts[reader] for reader in READERS)) if kind else math.nan
        told = f"{flops / 1e6:,.0f} | {100.0 * flops / peak:.0f} %" if kind else "– | –"
        print(f"| {name} | {rate:,.0f} | {n:.0f} | {clock / rate / n:,.0f} | {told} |", flush=True)


if __name__ == "__main__":
    main()
