"""Do proposals leave the workers idle? Time per candidate with the optimiser, against the same candidates given.

    python benchmarks/overlap.py [--switches 40000] [--lags 1,2,4] [--seeds 1-3] [--folder /tmp]

Every campaign runs on a local Dask cluster with one worker process, so that the driver has a core of its own. The
second campaign of each pair lists the first one's waveforms as its own: the same simulations, nothing to propose.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from softclose_store import Campaign, open_campaign

FIRST, BUDGET = 40, 80
"""The surrogate has FIRST points when the clock starts."""


def run(folder: Path, name: str, seed: int, lag: int, switches: int, initial: list[object]) -> Campaign:
    """One campaign, run to its end. initial: waveforms given in place of proposals."""
    source, store = folder / f"{name}.toml", folder / f"{name}.zarr"
    source.write_text(
        f"campaign = {{ seed = {seed}, budget = {BUDGET}, lag = {lag} }}\n"
        f'population = {{ name = "current", n_switches = {switches}, sampling = "sobol" }}\n'
        f'waveform = {{ space = "three-pulse-full", initial = {initial!r} }}\n'
        "store = { n_times = 101, max_impacts = 32 }\n"
    )
    command = [sys.executable, "-m", "softclose_workflows", "run", str(source), "--store", str(store)]
    subprocess.run([*command, "--workers", "1", "--quiet"], check=True, stdout=subprocess.DEVNULL)
    return open_campaign(store)


def per_candidate(campaign: Campaign) -> float:
    """Seconds from commit to commit, mean over the candidates after FIRST."""
    committed: NDArray[np.float64] = campaign.records()["wall_committed_unix_s"]
    return float((committed[-1] - committed[FIRST]) / (len(committed) - 1 - FIRST))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--switches", type=int, default=40_000)
    parser.add_argument("--lags", default="1,2,4")
    parser.add_argument("--seeds", default="1-3", help="first-last")
    parser.add_argument("--folder", type=Path, help="where the stores are written for the time being")
    options = parser.parse_args()
    first, last = (int(v) for v in options.seeds.split("-"))
    lags = [int(v) for v in options.lags.split(",")]
    print(f"three pulses, N = {options.switches}, candidates {FIRST} to {BUDGET}, one worker, seeds {options.seeds}")
    print("| lag | s a candidate, proposed | the same, given | ratio | a proposal, s | ratio of each seed |")
    print("| --- | --- | --- | --- | --- | --- |")
    measured: dict[int, list[tuple[float, float, float]]] = {lag: [] for lag in lags}
    for seed in range(first, last + 1):
        for lag in lags:
            with tempfile.TemporaryDirectory(dir=options.folder) as scratch:
                folder = Path(scratch)
                proposed = run(folder, "proposed", seed, lag, options.switches, [])
                waveforms: list[object] = [proposed.waveform(i).tolist() for i in range(BUDGET)]
                given = run(folder, "given", seed, lag, options.switches, waveforms)
                proposal = float(np.median(proposed.records()["wall_propose_s"][FIRST:]))
                measured[lag].append((per_candidate(proposed), per_candidate(given), proposal))
    for lag in lags:
        took, alone, proposal = np.median(measured[lag], axis=0)
        ratios = np.array([a / b for a, b, _ in measured[lag]])
        each = " ".join(f"{r:.2f}" for r in np.sort(ratios))
        print(f"| {lag} | {took:.2f} | {alone:.2f} | {np.median(ratios):.2f} | {proposal:.2f} | {each} |", flush=True)


if __name__ == "__main__":
    main()
