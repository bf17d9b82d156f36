"""Whole campaigns against a smooth stand-in for the simulation: a bowl around 0.4 in the search cube."""

from __future__ import annotations

import dataclasses
import math

from softclose.propose.plan import plan
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import Observation, Problem
from softclose.settings import load_config

SPACE_OF = {"paper": "two-pulse-paper"}


def problem_of(
    engine="skopt", budget=24, *, campaign=None, explore=None, finish=None, waveform=None, prior=None, **optimiser
):
    return Problem(
        load_config(
            {
                "campaign": {"seed": 5, "budget": budget} | (campaign or {}),
                "population": {"n_switches": 50},
                "waveform": {"space": SPACE_OF.get(engine, "two-pulse-full")} | (waveform or {}),
                "optimiser": {"engine": engine, "n_initial": 8, "n_candidates": 128} | optimiser,
                "prior": {"model": "none"} | (prior or {}),
                "explore": {"generation": 6, "n_scouts": 6} | (explore or {}),
                "finish": {"n_switches": 100, "n_basins": 3} | (finish or {}),
            }
        )
    )


def observation(index, waveform, g, *, wave=None, origin="sobol", n_switches=100, v_u=None, failed=False, **others):
    """What is known of a candidate of this g, by which it is ranked; wave: by default one of its own."""
    v_u = g if v_u is None else v_u
    return Observation(
        index=index,
        wave=index if wave is None else wave,
        waveform=waveform,
        origin=origin,
        n_switches=n_switches,
        g_cm_s=g,
        rank_cm_s=g,
        v_u_cm_s=v_u,
        mean_cm_s=v_u,
        failed=failed,
        **{"g_se_cm_s": 0.1, "p_nc": 0.0, "p_contact": 1.0} | others,
    )


def proposed(index, wave, proposal, g, **others):
    """What is known of what was proposed."""
    own = {"origin": proposal.origin, "n_switches": proposal.n_switches}
    return observation(index, proposal.waveform, g, wave=wave, **own, **others)


def observe(problem, wave, i, proposal, *, failed=False):
    """A smooth stand-in for the simulation: a bowl around 0.4 in the cube, in cm/s."""
    w = proposal.waveform
    try:
        x = problem.space.unit(w, clip=True)
        g = 15.0 + 60.0 * float(((x - 0.4) ** 2).mean())
    except ValueError:
        g = 85.0
    g = math.nan if failed else g
    touching = min(1.0, w.pulses[0].peak_us / 10.0)
    return proposed(i, wave.index, proposal, g, g_se_cm_s=0.5, p_contact=touching, failed=failed)


def with_g(o, g, **others):
    """The same observation with another objective, by which it is ranked."""
    return dataclasses.replace(o, g_cm_s=g, rank_cm_s=g, **others)


def run(problem, *, failing=()):
    """A whole campaign against the stand-in: its records and its proposals."""
    proposer = Proposer(problem)
    history, proposals = [], []
    for wave in plan(problem):
        new = proposer.from_history(wave, history)
        assert len(new) == wave.size
        for i, proposal in enumerate(new, start=wave.start):
            proposal.waveform.check(150.0, 250.0)
            assert proposal.n_switches == wave.n_switches
            history.append(observe(problem, wave, i, proposal, failed=i in failing))
        proposals += new
    return history, proposals


def bits(proposals):
    return [p.waveform.rows().tobytes() for p in proposals]
