"""Other people's optimisers on the same ensembles with the same budgets, a line of JSON a run.

    python benchmarks/peers.py --envs /tmp/peers --peers optuna-tpe,cma --seeds 1-5 >> peers.jsonl
    python benchmarks/peers.py --peers cma --budget 5000 >> peers.jsonl
    python benchmarks/peers.py --table peers.jsonl

Each peer runs in an environment of its own (made below --envs by pip, once) and is asked over a pipe: none of them is a
dependency. In our coordinates (the unit cube of the search space), or with --raw in plain pulse parameters, where a
waveform above the voltage limit counts as one that never closes. `ours` is the engine of the preset with its prior,
whose trajectories count too; it alone takes --set. The best is certified on fresh switches. Times are of the processor,
proposals' alone.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
import venv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from prior import run, seeds_of, value

from softclose.conditions.streams import Ensemble
from softclose.evaluate import draw
from softclose.propose.protocol import Problem
from softclose.propose.side_by_side import with_seed
from softclose.settings import CampaignConfig, load_config
from softclose.waveform import Pulse, Waveform
from softclose.waveform.pulses import WaveformError

PACKAGES: dict[str, list[str]] = {
    "random": [],
    "optuna-tpe": ["optuna"],
    "optuna-gp": ["optuna", "torch", "scipy"],
    "optuna-cma": ["optuna", "cmaes"],
    "cma": ["cma"],
    "skopt": ["scikit-optimize"],
    "nevergrad": ["nevergrad"],
    "smac-forest": ["smac"],
    "smac-gp": ["smac"],
    "botorch": ["botorch"],
}
NEVER_CM_S = 85.0
"""What a waveform counts as that cannot be driven: one under which nothing touches."""


def python_of(peer: str, folder: Path) -> Path:
    """The interpreter of a peer's environment, made where it is not yet; this one where a peer needs no package."""
    if not PACKAGES[peer]:
        return Path(sys.executable)
    home = folder / "-".join(PACKAGES[peer])
    python = home / "bin" / "python"
    if not (home / "whole").exists():
        venv.create(home, with_pip=True, clear=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES[peer]], check=True, stdout=sys.stderr)
        (home / "whole").touch()
    return python


def raw_waveform(point: list[float], n_pulses: int, config: CampaignConfig) -> Waveform:
    """Plain parameters: of every pulse rise, time at its peak and volts, of all but the first its delay too."""
    least, most = config.waveform.min_rise_us, config.waveform.max_volts
    x = iter(point)
    start, pulses = 0.0, []
    for k in range(n_pulses):
        last = k == n_pulses - 1
        if k:
            start += 100.0 * next(x)
        rise = least + 46.0 * next(x)
        peak = math.inf if last else 30.0 * next(x)
        pulses.append(Pulse(start, rise, peak, most * (0.02 + 0.98 * next(x))))
    return Waveform(pulses)


def raw_dimensions(n_pulses: int) -> int:
    return 4 * n_pulses - 2


def one(peer: str, config: CampaignConfig, *, raw: bool, budget: int, python: Path, n_fresh: int) -> dict[str, Any]:
    """One peer on one seed."""
    space = Problem(config).space
    lot = draw(config, config.population.n_switches, seed=config.campaign.seed, sampling=config.population.sampling)
    to_waveform: Callable[[list[float]], Waveform] = (
        (lambda point: raw_waveform(point, space.n_pulses, config)) if raw else (lambda point: space.waveform(point))
    )
    dim = raw_dimensions(space.n_pulses) if raw else space.dim
    script = Path(__file__).with_name("peer.py")
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    environment |= {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
    best, best_g, seconds, n = None, math.inf, 0.0, 0
    with subprocess.Popen(
        [python, script, peer, str(dim), str(config.campaign.seed), str(budget)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        for line in process.stdout:
            told = json.loads(line)
            seconds, n = seconds + told["s"], n + 1
            waveform = to_waveform(told["point"])
            try:
                waveform.check(config.waveform.max_volts, config.model.horizon_us, config.waveform.least_rise_us)
                g = value(config, lot, waveform)[0]
            except WaveformError:
                g = NEVER_CM_S
            if g < best_g:
                best, best_g = waveform, g
            process.stdin.write(json.dumps(g) + "\n")
            process.stdin.flush()
    if process.returncode or best is None or n < budget:
        raise RuntimeError(f"{peer} ended after {n} of {budget} candidates")
    fresh = draw(config, n_fresh, seed=config.campaign.seed, ensemble=Ensemble.CERTIFICATE)
    return {
        "training": round(best_g, 3),
        "certified": round(value(config, fresh, best)[0], 3),
        "propose_ms": round(1e3 * seconds / n, 1),
        "trajectories": budget * len(lot),
    }


def ours(peer: str, settings: list[str], seed: int, n_fresh: int) -> dict[str, Any]:
    """Our engine on one seed, with its prior or without."""
    without = ["prior.model=none"] if peer == "ours-without-prior" else []
    found = run(with_seed(load_config("current", [*settings, *without]), seed), n_fresh)
    last = {name: list(found[name].values())[-1] for name in ("training", "certified")}
    trajectories = found["campaign_trajectories"] + found["prior_trajectories"]
    return last | {"propose_ms": found["propose_ms"], "trajectories": trajectories}


def table(path: Path) -> None:
    rows: dict[tuple[str, str, str, int, float], list[dict[str, Any]]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        r = json.loads(line)
        million = round(r["trajectories"] / 1e6, 2)
        rows.setdefault((r["space"], r["peer"], r["coordinates"], r["budget"], million), []).append(r)
    print("| space | peer | coordinates | candidates | million | certified g | training g | a proposal, ms |")
    print("| --- | --- | --- | ---: | ---: | --- | --- | ---: |")
    for key, runs in sorted(rows.items(), key=lambda item: np.median([r["certified"] for r in item[1]])):
        by_end = sorted(runs, key=lambda r: r["certified"])
        certified, training = (" ".join(f"{r[name]:.2f}" for r in by_end) for name in ("certified", "training"))
        propose = np.median([r["propose_ms"] for r in runs])
        print(f"| {' | '.join(map(str, key))} | {certified} | {training} | {propose:.0f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", default=f"ours,ours-without-prior,{','.join(PACKAGES)}")
    parser.add_argument("--envs", type=Path, default=Path("build/peers"))
    parser.add_argument("--space", default="three-pulse-full")
    parser.add_argument("--seeds", type=seeds_of, default=seeds_of("1-5"))
    parser.add_argument("--budget", type=int, default=200)
    parser.add_argument("--switches", type=int, default=200)
    parser.add_argument("--raw", action="store_true", help="plain pulse parameters in the place of our coordinates")
    parser.add_argument("--fresh", type=int, default=100_000)
    parser.add_argument("--set", action="append", default=[], dest="settings", help="of our engine alone")
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    if given.table:
        table(given.table)
        return
    peers = given.peers.split(",")
    if given.raw and any(peer.startswith("ours") for peer in peers):
        parser.error("our engine has coordinates of its own: it has no --raw")
    settings = [
        f"waveform.space={given.space}",
        f"campaign.budget={given.budget}",
        f"population.n_switches={given.switches}",
        "population.sampling=monte-carlo",
    ]
    for peer in peers:
        for seed in given.seeds:
            config = with_seed(load_config("current", settings), seed)
            said: dict[str, Any] = {"space": given.space, "peer": peer, "budget": given.budget, "seed": seed}
            said["coordinates"] = "raw" if given.raw else "ours"
            began = time.perf_counter()
            if peer.startswith("ours"):
                said |= ours(peer, [*settings, *given.settings], seed, given.fresh)
            else:
                python = python_of(peer, given.envs.absolute())
                said |= one(peer, config, raw=given.raw, budget=given.budget, python=python, n_fresh=given.fresh)
            said["wall_s"] = round(time.perf_counter() - began, 1)
            print(json.dumps(said), flush=True)
            print(f"{peer} {seed}: {said['certified']}", file=sys.stderr)


if __name__ == "__main__":
    main()
