"""Owns the comparison of engines on one problem, in this process: best objective against evaluations and against
time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softclose.arrays import FloatArray
from softclose.evaluate import draw, judge, respond
from softclose.evaluate.asked import told
from softclose.population.lot import Lot
from softclose.propose.plan import plan
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import Engine, Observation, Problem, Proposal, Wave, WaveEngine
from softclose.settings import CampaignConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineRun:
    """One engine on one seed; the seed draws the ensemble and keys the engine's random numbers."""

    engine: str
    seed: int
    best_g_cm_s: FloatArray
    """(n,) best g after each evaluation [cm/s], among those on the largest ensemble so far; infinite before the
    first."""
    wall_s: FloatArray
    """(n,) time since the start, simulation included [s]."""
    propose_s: FloatArray
    """(n,) time of each proposal [s]."""
    best: Observation
    """The best candidate on the largest ensemble: the finishing stage's where there was one."""


def evaluate(problem: Problem, switches: Lot, wave: Wave, index: int, proposal: Proposal) -> Observation:
    """Simulate and assess one proposal on the first of the switches; without store or cluster."""
    config = problem.config
    lot = switches.rows(slice(proposal.n_switches))
    response = respond(config, lot, proposal.waveform, max_volts=config.waveform.max_volts)
    a = judge(config, response)
    return Observation(
        index=index,
        wave=wave.index,
        waveform=proposal.waveform,
        origin=proposal.origin,
        n_switches=proposal.n_switches,
        g_cm_s=a.g_cm_s,
        g_se_cm_s=a.g_se_cm_s,
        v_u_cm_s=a.v_u_cm_s,
        mean_cm_s=a.mean_cm_s,
        p_nc=a.p_nc,
        p_contact=a.p_contact,
        rank_cm_s=a.rank_cm_s,
        failed=False,
        closing_us=a.closing_us,
        beliefs=proposal.surrogate,
        quantities={name: value.estimate for name, value in told(config, response, a).items()},
    )


def with_seed(config: CampaignConfig, seed: int) -> CampaignConfig:
    """The same campaign with another seed."""
    return replace(config, campaign=replace(config.campaign, seed=seed))


def run_engine(
    config: CampaignConfig, engine: Engine | WaveEngine | str, *, evaluator: Callable[..., Observation] = evaluate
) -> tuple[list[Observation], FloatArray, FloatArray]:
    """A whole campaign in this process: its observations, (n,) times since the start and (n,) proposal times [s].

    One candidate after the other, yet proposals see no more than they would with the plan's waves in flight. The time
    of a proposal is its share of its wave's.
    """
    if isinstance(engine, str):
        config = replace(config, optimiser=replace(config.optimiser, engine=engine))
    problem = Problem(config)
    search = None if isinstance(engine, str) else engine
    proposer = Proposer(problem, search)
    switches = draw(config, config.n_switches_max, seed=config.campaign.seed, sampling=config.population.sampling)
    history: list[Observation] = []
    wall, spent = [], []
    begin = time.perf_counter()
    for wave in plan(problem, search):
        asked = time.perf_counter()
        proposals = proposer.from_history(wave, history)
        spent += [(time.perf_counter() - asked) / wave.size] * wave.size
        for index, proposal in enumerate(proposals, start=wave.start):
            history.append(evaluator(problem, switches, wave, index, proposal))
            wall.append(time.perf_counter() - begin)
    return history, np.array(wall), np.array(spent)


def compare_engines(config: CampaignConfig, engines: Sequence[str], seeds: Sequence[int]) -> Iterator[EngineRun]:
    """Every engine on every seed, one run at a time as they end.

    Evaluations count alike for all: a candidate is one, whatever the engine does with it.
    """
    for engine in engines:
        for seed in seeds:
            history, wall, spent = run_engine(with_seed(config, seed), engine)
            best = best_so_far(history)
            if best[-1] is None:
                raise ValueError(f"{engine}, seed {seed}: none of its candidates has an objective")
            yield EngineRun(
                engine=engine,
                seed=seed,
                best_g_cm_s=np.array([o.g_cm_s if o else np.inf for o in best]),
                wall_s=wall,
                propose_s=spent,
                best=best[-1],
            )


def best_so_far(history: Sequence[Observation]) -> list[Observation | None]:
    """The best after each candidate, among those on the largest ensemble so far (scores on few are optimistic)."""
    best: Observation | None = None
    found = []
    for o in history:
        if o.usable and (
            best is None
            or o.n_switches > best.n_switches
            or (o.n_switches == best.n_switches and o.rank_cm_s < best.rank_cm_s)
        ):
            best = o
        found.append(best)
    return found
