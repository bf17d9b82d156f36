"""What the prior, the process and both are worth, and the descents that they replace: a line of JSON a run.

    python benchmarks/prior.py current-three --arms led,process,descents --seeds 901-910 >> prior.jsonl
    python benchmarks/prior.py --table prior.jsonl

`led` is the preset: the process from its prior. Its line says too what the prior alone is worth, the best basin
certified as it is. `process` has no prior; `descents` has no process: each has as many trajectories as `led` in all,
the process by more candidates, descents a third of them exploring on 256 switches and the rest polishing on the
preset's ensemble. In this process, one candidate after the other; the best is certified on fresh switches that no
search saw, and so is the best after so many candidates.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from softclose.conditions.streams import Ensemble
from softclose.evaluate import draw, objective_settings, respond
from softclose.metrics.ranking import rank_cm_s
from softclose.metrics.value import objective_value
from softclose.population.lot import Lot
from softclose.propose.plan import plan
from softclose.propose.prior import NOT_OF_G, Prior, PriorValues
from softclose.propose.prior_basins import Basins, find_basins
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import Observation, Problem
from softclose.propose.side_by_side import best_so_far, with_seed
from softclose.settings import CampaignConfig, load_config
from softclose.waveform import Waveform

ARMS = ("led", "process", "descents")
MARKS = (10, 20, 40, 60, 100, 200)


@dataclass
class Counted:
    """The prior in this process, with what it was asked."""

    config: CampaignConfig
    prior: Prior = field(init=False)
    trajectories: int = 0
    seconds: float = 0.0

    def __post_init__(self) -> None:
        self.prior = Prior.of(self.config)

    def basins(self) -> Basins:
        return find_basins(self.config, self.values)

    def values(self, waveforms: Sequence[Waveform], n_switches: int | None = None) -> PriorValues:
        began = time.process_time()
        found = self.prior.values(waveforms, n_switches)
        self.seconds += time.process_time() - began
        self.trajectories += len(waveforms) * (n_switches or len(self.prior.lot))
        return found


def value(config: CampaignConfig, lot: Lot, waveform: Waveform) -> tuple[float, float]:
    """g [cm/s] and the share open."""
    settings = {name: v for name, v in objective_settings(config).items() if name not in NOT_OF_G}
    return objective_value(respond(config, lot, waveform), **settings)


def run(config: CampaignConfig, n_fresh: int) -> dict[str, Any]:
    """One campaign: what it found, certified, and what it took."""
    began = time.process_time()
    counted = Counted(config) if config.has_prior else None
    problem = Problem(config, help=counted)
    basins = problem.basins
    found_s = time.process_time() - began
    proposer = Proposer(problem)
    lot = draw(config, config.n_switches_max, seed=config.campaign.seed, sampling=config.population.sampling)
    history: list[Observation] = []
    propose_s, campaign = 0.0, 0
    prior_before = counted.seconds if counted else 0.0
    for wave in plan(problem):
        asked = time.process_time()
        proposals = proposer.from_history(wave, history)
        propose_s += time.process_time() - asked
        for i, p in enumerate(proposals, start=wave.start):
            g, p_nc = value(config, lot.rows(slice(p.n_switches)), p.waveform)
            campaign += p.n_switches
            history.append(
                Observation(
                    index=i,
                    wave=wave.index,
                    waveform=p.waveform,
                    origin=p.origin,
                    n_switches=p.n_switches,
                    g_cm_s=g,
                    rank_cm_s=rank_cm_s(g, p_nc, config.objective.max_open),
                    g_se_cm_s=np.nan,
                    v_u_cm_s=np.nan,
                    mean_cm_s=np.nan,
                    p_nc=p_nc,
                    p_contact=np.nan,
                    failed=not np.isfinite(g),
                    beliefs=p.surrogate,
                )
            )
    took = time.process_time() - began
    fresh = draw(config, n_fresh, seed=config.campaign.seed, ensemble=Ensemble.CERTIFICATE)
    best = best_so_far(history)
    marks = sorted({m for m in MARKS if m < len(history)} | {len(history)})
    certified: dict[int, float] = {}
    for m in marks:
        o = best[m - 1]
        if o is not None and o.index not in certified:
            certified[o.index] = value(config, fresh, o.waveform)[0]
    z = [
        abs(o.g_cm_s - o.beliefs["predicted_g_cm_s"]) / o.beliefs["predicted_sd_cm_s"]
        for o in history
        if o.usable and "predicted_sd_cm_s" in o.beliefs
    ]
    said: dict[str, Any] = {
        "seed": config.campaign.seed,
        "n_switches": config.n_switches_max,
        "candidates": len(history),
        "training": {m: round(o.g_cm_s, 3) for m in marks if (o := best[m - 1]) is not None},
        "certified": {m: round(certified[o.index], 3) for m in marks if (o := best[m - 1]) is not None},
        "within_1": round(float(np.mean(np.array(z) < 1.0)), 3) if z else None,
        "within_2": round(float(np.mean(np.array(z) < 2.0)), 3) if z else None,
        "campaign_trajectories": campaign,
        "prior_trajectories": counted.trajectories if counted else 0,
        "processor_s": round(took, 1),
        "propose_ms": round(1e3 * propose_s / len(history), 1),
        "basins_s": round(found_s, 1),
        "own_ms_per_candidate": round(
            1e3 * (propose_s - ((counted.seconds - prior_before) if counted else 0.0)) / len(history), 1
        ),
        "best_origin": best[-1].origin if best[-1] is not None else "",
    }
    if basins is not None and basins.waveforms:
        said |= {
            "promised": [round(float(g), 2) for g in basins.g_cm_s],
            "first": [round(o.g_cm_s, 2) for o in history[: len(basins.waveforms)]],
            "prior_certified": round(value(config, fresh, basins.waveforms[0])[0], 3),
        }
    return said


def overrides(arm: str, config: CampaignConfig) -> list[str]:
    """What makes an arm of a preset."""
    if arm == "led":
        return []
    p, n = config.prior, config.population.n_switches
    looks = (config.campaign.budget - config.optimiser.n_regions) * p.looks * p.n_switches
    total = p.budget * p.n_exploring + p.polish * p.n_switches + looks + config.campaign.budget * n
    if arm == "process":
        return ["prior.model=none", f"campaign.budget={total // n}"]
    explore = max(total // 3 // 256 // 20 * 20, 320)
    polish = max((total - 256 * explore) // n, 20)
    return [
        "campaign.budget=0",
        "population.n_switches=256",
        f"explore.budget={explore}",
        f"explore.n_descents={p.n_descents}",
        f"finish.budget={8 + polish}",
        f"finish.n_switches={n}",
    ]


def seeds_of(text: str) -> list[int]:
    first, _, last = text.partition("-")
    return list(range(int(first), int(last or first) + 1))


def table(path: Path) -> None:
    """A row for each preset and arm: certified g of every seed, sorted, and what it took in the median."""
    rows: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        found = json.loads(line)
        rows.setdefault((found["preset"], found["arm"]), []).append(found)
    print("| preset | arm | seeds | certified g | training g | million trajectories | processor s | within 1, 2 |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")

    def last(found: dict[str, Any], name: str) -> float:
        return float(list(found[name].values())[-1])

    for (preset, arm), runs in rows.items():
        by_end = sorted(runs, key=lambda r: last(r, "certified"))
        million = [(r["campaign_trajectories"] + r["prior_trajectories"]) / 1e6 for r in runs]
        within = [
            f"{np.mean([r[k] for r in runs if r[k] is not None]):.0%}" if any(r[k] is not None for r in runs) else "–"
            for k in ("within_1", "within_2")
        ]
        certified, training = (" ".join(f"{last(r, name):.2f}" for r in by_end) for name in ("certified", "training"))
        took = np.median([r["processor_s"] for r in runs])
        print(
            f"| {preset} | {arm} | {len(runs)} | {certified} | {training} | {np.median(million):.2f} | {took:.0f} | "
            f"{', '.join(within)} |"
        )
        alone = [r["prior_certified"] for r in runs if "prior_certified" in r]
        if alone:
            print(f"| {preset} | prior alone | {len(alone)} | {' '.join(f'{g:.2f}' for g in sorted(alone))} | | | | |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("preset", nargs="?", default="current-three")
    parser.add_argument("--arms", default=",".join(ARMS))
    parser.add_argument("--seeds", type=seeds_of, default=seeds_of("901-910"))
    parser.add_argument("--set", action="append", default=[], dest="settings")
    parser.add_argument("--label", help="what the preset is called in the lines")
    parser.add_argument("--fresh", type=int, default=100_000)
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    if given.table:
        table(given.table)
        return
    whole = load_config(given.preset, given.settings)
    for seed in given.seeds:
        for arm in given.arms.split(","):
            config = with_seed(load_config(given.preset, [*given.settings, *overrides(arm, whole)]), seed)
            said = {"preset": given.label or given.preset, "arm": arm} | run(config, given.fresh)
            print(json.dumps(said), flush=True)
            print(f"{said['preset']} {arm} {seed}: {list(said['certified'].values())[-1]}", file=sys.stderr)


if __name__ == "__main__":
    main()
