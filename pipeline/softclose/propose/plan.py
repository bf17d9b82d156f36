"""Owns the plan of a campaign: its waves, from the configuration alone.

Each stage says how many waves are in flight at once: a search sees all but the latest `campaign.lag` - 1; descents that
take turns wait for their own latest wave; a polish waits for everything. Extensions come last.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

from softclose.propose.explore import explore_ladder
from softclose.propose.extensions import extensions, problem_of
from softclose.propose.protocol import Engine, EngineError, Problem, Wave, WaveEngine, even_waves, load_engine
from softclose.settings import CampaignConfig

SEARCH, EXPLORE, FINISH = "search", "explore", "finish"
"""Stages of a campaign, in their order."""

BLIND_LAG = 4
"""Waves in flight at once of an engine that looks at no result: none of them waits, and workers meet the end of one
wave with tasks of the next."""


def plan(problem: Problem, search: Engine | WaveEngine | None = None) -> tuple[Wave, ...]:
    """The waves of a campaign, which cover `config.total_budget` candidates in order.

    search: the search's engine; as a rule the one that the configuration names. Raises EngineError where the engine is
    missing, or plans waves that do not make up its budget.
    """
    config = problem.config
    waves: list[Wave] = []

    def add(stage: str, sizes: list[int], n_switches: int | list[int], sees: Callable[[int], int]) -> None:
        each = n_switches if isinstance(n_switches, list) else [n_switches] * len(sizes)
        for size, n in zip(sizes, each, strict=True):
            index = len(waves)
            start = waves[-1].stop if waves else 0
            waves.append(Wave(index=index, stage=stage, start=start, size=size, n_switches=n, sees=sees(index)))

    few, many = config.population.n_switches, config.finish.n_switches
    engine = search or config.optimiser.engine
    lag = lag_of(config, engine) if config.campaign.budget else 1
    add(
        SEARCH,
        _sizes(problem, engine, config.campaign.budget),
        few,
        lambda w: max(w - lag + 1, 0),
    )
    first = len(waves)
    steps = explore_ladder(problem).steps
    add(EXPLORE, [step.size for step in steps], few, lambda w: first + steps[w - first].before + 1)
    sizes = _sizes(problem, FINISH, config.finish.budget)
    add(FINISH, sizes, growing(sizes, few, many) if config.finish.grows else many, lambda w: w)
    for extension in extensions(config).values():
        if not extension.is_search:
            add(extension.stage, _sizes(problem, extension.engine, extension.size), extension.n_switches, lambda w: w)
        else:
            whole = _sizes(problem_of(problem, extension), search or extension.engine, extension.begin + extension.size)
            sizes, lag = _after(whole, extension.begin), lag_of(config, search or extension.engine)
            add(extension.stage, sizes, extension.n_switches, lambda w, lag=lag: max(w - lag + 1, 0))  # type: ignore[misc]
    return tuple(waves)


def engine_of(config: CampaignConfig, stage: str) -> str:
    """Who proposes the candidates of a stage, by name."""
    if stage == SEARCH:
        return config.optimiser.engine
    if stage == EXPLORE:
        return "cmaes"
    return config.finish.method if stage == FINISH else extensions(config)[stage].engine


def lag_of(config: CampaignConfig, who: str | Engine | WaveEngine) -> int:
    """Waves of a search that are in flight at once: more than `campaign.lag` where the engine looks at no result."""
    engine = load_engine(who) if isinstance(who, str) else who
    return max(config.campaign.lag, BLIND_LAG if getattr(engine, "is_blind", False) else 1)


def growing(sizes: list[int], few: int, many: int) -> list[int]:
    """Switches of each wave: doubled from few to many in equal parts of the candidates; the last wave has them all.

    Ensembles are nested, so what is larger is the same switches and others: common random numbers.
    """
    steps = [few]
    while 2 * steps[-1] < many:
        steps.append(2 * steps[-1])
    if steps[-1] < many:
        steps.append(many)
    ends = list(itertools.accumulate(sizes))
    total = ends[-1] if ends else 1
    found = [
        steps[min(len(steps) * (end - size) // total, len(steps) - 1)] for size, end in zip(sizes, ends, strict=True)
    ]
    return [*found[:-1], many] if found else []


def _after(sizes: list[int], begin: int) -> list[int]:
    """What waves of these sizes have left after the first `begin` candidates."""
    ends = itertools.accumulate(sizes)
    return [min(size, end - begin) for size, end in zip(sizes, ends, strict=True) if end > begin]


def _sizes(problem: Problem, who: str | Engine | WaveEngine, budget: int) -> list[int]:
    if not budget:
        return []
    engine = load_engine(who) if isinstance(who, str) else who
    if not isinstance(engine, WaveEngine):
        return even_waves(budget, problem.config.campaign.wave)
    sizes = [int(size) for size in engine.wave_sizes(problem, budget)]
    if sum(sizes) != budget or min(sizes) < 1:
        raise EngineError(
            f"engine {who!r} plans waves of {sizes}; they must be 1 or more each and {budget} in all (wave_sizes)"
        )
    return sizes
