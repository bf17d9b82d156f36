"""Owns `[optimiser]`, `[explore]` and `[finish]`: who proposes, and how much."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from softclose.allowed.types import (
    MAX_COUNT,
    MOST_IN_A_WAVE,
    SETTINGS,
    Count,
    Positive,
    SwitchCount,
)


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class OptimiserSection:
    """Who proposes."""

    engine: Annotated[str, Field(min_length=1)] = "skopt"
    """skopt, sobol, paper, direct, cmaes, botorch, parego and nsga2 (a front of `objectives`), or an installed entry
    point of group softclose.engines."""
    objectives: tuple[str, ...] = ("v_u", "p_nc")
    """parego, nsga2: what they weigh against each other, two to four quantities: v_u, p_nc, closing (time), peak
    (volts), or any other that `softclose.quantity` knows."""
    n_initial: Annotated[int, Field(ge=2, le=MOST_IN_A_WAVE, strict=True)] = 20
    """Space-filling candidates before the surrogate proposes, one wave; `waveform.initial` takes the first places."""
    batch: Annotated[int, Field(ge=1, le=MOST_IN_A_WAVE, strict=True)] = 4
    """Candidates that the surrogate proposes together, a wave."""
    n_regions: Annotated[int, Field(ge=1, le=64, strict=True)] = 6
    """With a prior: trust regions of the process, one a basin of the prior; each has a candidate in the first wave."""
    rounds: Annotated[int, Field(ge=1, le=16, strict=True)] = 3
    """With a prior: rounds of equal budgets; after each the better half of the trust regions goes on."""
    n_starts: Annotated[int, Field(ge=1, le=64, strict=True)] = 4
    """Without a prior: trust regions, around the best points of the design. Halving them has a quarter of the
    candidates; the last one has the rest."""
    n_restart: Annotated[int, Field(ge=2, le=MAX_COUNT, strict=True)] = 8
    """Space-filling candidates after a single trust region has shrunk to nothing, before it starts again elsewhere."""
    fresh_every: Count = 1
    """Every so many restarts of a single trust region begin elsewhere; the others open it again around the best
    candidate, as one of several always does."""
    n_candidates: Annotated[int, Field(ge=16, le=100_000, strict=True)] = 2000
    """Points at which the acquisition is screened."""
    fit_iterations: Count = 20
    """L-BFGS iterations of the surrogate's likelihood, from a fixed start."""
    n_fit: Annotated[int, Field(ge=16, le=MAX_COUNT, strict=True)] = 100
    """Points nearest to the best candidate from which the hyperparameters are fitted; the surrogate uses all points."""
    length_initial: Positive = 0.4
    """Width of the trust region at the start, in units of the search cube."""
    length_min: Positive = 0.03
    """Width below which the trust region starts again."""
    length_max: Positive = 1.6
    """Largest width."""
    success_tolerance: Count = 3
    """Successful waves in a row that double the trust region."""
    failure_tolerance: Annotated[int, Field(ge=0, le=MAX_COUNT, strict=True)] = 0
    """Candidates of failed waves in a row that halve it; 0: as many as there are parameters."""
    improvement_cm_s: Annotated[float, Field(ge=0)] = 0.01
    """Least decrease of g that counts as a success [cm/s]."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class ExploreSection:
    """Exploring: CMA-ES descents from several points, on the search's ensemble, by successive halving."""

    budget: Annotated[int, Field(ge=0, le=MAX_COUNT, strict=True)] = 0
    """Candidates of the descents; 0 leaves them out."""
    n_descents: Annotated[int, Field(ge=1, le=64, strict=True)] = 4
    """Descents begun; the better half goes on after each round. The first begins at the best of the search."""
    generation: Annotated[int, Field(ge=4, le=256, strict=True)] = 20
    """Candidates of one descent in one wave, in polishing too."""
    n_scouts: Annotated[int, Field(ge=1, le=256, strict=True)] = 40
    """Space-filling candidates of each descent; it begins at the best of them."""
    sigma: Annotated[float, Field(gt=0, le=0.5)] = 0.12
    """Size of a descent's first steps, in units of the search cube."""
    rounds: Annotated[int, Field(ge=1, le=16, strict=True)] = 2
    """Rounds of equal budgets; after each the better half of the descents goes on."""
    turns: Annotated[int, Field(ge=1, le=64, strict=True)] = 2
    """Sets of descents that take turns: waves in flight at once."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class FinishSection:
    """The finishing stage: further candidates on larger ensembles."""

    budget: Annotated[int, Field(ge=0, le=MAX_COUNT, strict=True)] = 0
    """Candidates of the finishing stage; 0 leaves it out."""
    n_switches: SwitchCount = 2000
    """Switches per candidate of the finishing stage."""
    grows: bool = False
    """cmaes: the polish begins on population.n_switches switches and doubles them in equal parts of its budget, up to
    n_switches: fewer trajectories for the same end."""
    n_basins: Annotated[int, Field(ge=1, le=MOST_IN_A_WAVE, strict=True)] = 8
    """Distinct basins found so far that are evaluated again, best first, one wave."""
    n_polished: Annotated[int, Field(ge=1, le=64, strict=True)] = 2
    """Basins whose polish begins (cmaes); the better half goes on after each round of equal budgets."""
    distance: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Largest coordinate distance in the search cube below which two candidates are one basin."""
    method: Literal["surrogate", "cmaes", "nelder-mead"] = "cmaes"
    """How the best basins are polished: cmaes takes a few hundred candidates, surrogate suits costly ones."""
    sigma: Annotated[float, Field(gt=0, le=0.5)] = 0.02
    """Size of the first steps of the polish, at least, in units of the search cube."""
