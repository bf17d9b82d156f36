"""Owns the adapter to the generator standard of the optimisation frameworks (gest-api), so that Xopt, Optimas and
libEnsemble drive our engines: https://github.com/campa-consortium/gest-api.

Needs the package gest-api (extra `gest`). Whoever drives it evaluates the waveforms; nothing is stored.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from softclose.arrays import FloatArray
from softclose.metrics.ranking import rank_cm_s
from softclose.propose.plan import plan
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import Observation, Problem, Proposal, seen_by
from softclose.settings import CampaignConfig, load_config
from softclose.waveform import Waveform
from softclose.waveform.spaces import SpaceError
from softclose_workflows.errors import BenchError

try:
    from gest_api import Generator
    from gest_api.vocs import VOCS, MinimizeObjective
except ImportError as e:
    raise ImportError("the generator standard needs the package gest-api: pip install gest-api") from e

OBJECTIVE = "g_cm_s"
"""What is minimised, as the names of a store have it [cm/s]."""
MORE = ("g_se_cm_s", "v_u_cm_s", "mean_cm_s", "p_nc", "p_contact")
"""What a result may say beside it; NaN where it does not."""


class SoftcloseGenerator(Generator):  # type: ignore[misc]
    """The waves of a campaign as a generator: variables are the coordinates of its search space, in physical units.

    Parameters
    ----------
    vocs
        As `SoftcloseGenerator.vocs_of(source)` makes it; it may have constants, observables and its own names of the
        objective, but no constraints.
    source, settings
        The campaign: preset, TOML file or mapping, and `section.key=value`. Its engine proposes, within its budget.
    """

    returns_id = True

    def __init__(self, vocs: VOCS, source: Any = "current", settings: Iterable[str] = ()) -> None:
        self._start(load_config(source, settings))
        super().__init__(vocs)
        self.vocs = vocs
        """What was given: Xopt asks for it."""
        (self._objective,) = vocs.objectives

    @classmethod
    def vocs_of(cls, source: Any = "current", settings: Iterable[str] = ()) -> VOCS:
        """Variables with their ranges (`impulse1` [× coasting], `delay2` [periods], `rise1` [µs], `volts1` [V], …)."""
        space = Problem(load_config(source, settings)).space
        return VOCS(
            variables={c.name: [c.least, c.most] for c in space.coordinates}, objectives={OBJECTIVE: "MINIMIZE"}
        )

    def waveform(self, point: Mapping[str, Any]) -> Waveform:
        """The admissible waveform of a suggested point."""
        space = self._problem.space
        return space.waveform([float(c.unit(point[c.name])) for c in space.coordinates])

    def suggest(self, num_points: int | None = None) -> list[dict[str, Any]]:
        """See the standard. None: all that can be proposed before more results are in."""
        self._propose()
        if num_points is None:
            num_points = len(self._ready)
        while len(self._ready) < num_points and self._propose():
            pass
        if len(self._ready) < num_points or not num_points:
            left = "the budget is spent" if self._wave == len(self._waves) else "ingest results first"
            raise ValueError(f"{num_points or 'no'} points are asked for and {len(self._ready)} can be given: {left}")
        found = [self._ready.popleft() for _ in range(num_points)]
        self._out |= {i: proposal for i, proposal in found}
        return [self._point(proposal.waveform) | {"_id": i} for i, proposal in found]

    def ingest(self, results: list[dict[str, Any]]) -> None:
        """See the standard. Points of others (without `_id`) are taken before the first suggestion only.

        All results are taken, or none: each is looked at before anything changes. An objective that is NaN says that
        the evaluation failed.
        """
        told: dict[int, tuple[Mapping[str, Any], dict[str, float]]] = {}
        others: list[tuple[Mapping[str, Any], dict[str, float]]] = []
        for place, result in enumerate(results):
            numbers = self._numbers(place, result)
            if _is_unnamed(result):
                others.append((result, numbers))
                continue
            i = self._identity(result)
            if i not in self._out or i in told:
                raise ValueError(
                    f"the point {result['_id']!r} is not waited for: each result is ingested once, under its _id"
                )
            told[i] = result, numbers
        if others:
            self._begin_with(others)
        for i, (_, numbers) in told.items():
            self._told[i] = self._observation(i, self._out.pop(i), numbers)
        self._move_on()

    def _validate_vocs(self, vocs: VOCS) -> None:
        wanted = {c.name: (c.least, c.most) for c in self._problem.space.coordinates}
        if set(vocs.variables) != set(wanted):
            raise ValueError(f"the variables are {sorted(vocs.variables)}; this search has {sorted(wanted)} (vocs_of)")
        for name, (least, most) in wanted.items():
            domain = getattr(vocs.variables[name], "domain", None)
            if domain is None or not np.allclose(domain, (least, most)):
                raise ValueError(f"{name} is {domain}; its range is [{least:g}, {most:g}]: set limits in the campaign")
        if len(vocs.objectives) != 1 or not isinstance(next(iter(vocs.objectives.values())), MinimizeObjective):
            raise ValueError(f"the objectives are {dict(vocs.objectives)}; exactly one is minimised ({OBJECTIVE})")
        if vocs.constraints:
            raise ValueError("constraints are part of g here (objective.form, objective.p_max); give none")

    def _start(self, config: CampaignConfig) -> None:
        self._problem = Problem(config)
        self._proposer = Proposer(self._problem)
        self._waves = plan(self._problem)
        self._wave = 0
        self._history: list[Observation] = []
        self._ready: deque[tuple[int, Proposal]] = deque()
        self._out: dict[int, Proposal] = {}
        self._told: dict[int, Observation] = {}
        self._flying: list[Proposal] = []

    def _propose(self) -> bool:
        """The next wave, where all that it sees is known; True where there was one."""
        if self._wave == len(self._waves):
            return False
        wave = self._waves[self._wave]
        committed = self._history[-1].wave + 1 if self._history else 0
        if wave.sees > committed:
            return False
        seen = seen_by(wave, self._history)
        pending = [o.waveform for o in self._history[len(seen) :]] + [p.waveform for p in self._flying]
        proposals = self._proposer.propose(wave, seen, pending)
        self._wave += 1
        self._flying += proposals
        self._ready.extend(enumerate(proposals, start=wave.start))
        return True

    def _move_on(self) -> None:
        """Waves whose results are all in join the history, in order."""
        for wave in self._waves[: self._wave]:
            if wave.start != len(self._history):
                continue
            if any(i not in self._told for i in range(wave.start, wave.stop)):
                return
            self._history += [self._told.pop(i) for i in range(wave.start, wave.stop)]
            self._flying = self._flying[wave.size :]

    def _begin_with(self, points: Sequence[tuple[Mapping[str, Any], dict[str, float]]]) -> None:
        """Another's evaluations become the campaign's first candidates, with their results."""
        if self._wave:
            raise ValueError("points without _id were not suggested here; they are taken before the first suggestion")
        config = self._problem.config
        try:
            waveforms = [self.waveform(point) for point, _ in points]
        except (KeyError, TypeError, ValueError, SpaceError) as e:
            raise BenchError(f"a point lacks a variable of this search, or it is no number ({e!r})") from e
        for point, _ in points:
            self._require_in_range(point)
        initial = [*config.waveform.initial_waveforms(), *waveforms]
        known = len(initial) - len(waveforms)
        rows = tuple(tuple(tuple(row) for row in w.rows().tolist()) for w in initial)
        self._start(replace(config, waveform=replace(config.waveform, initial=rows)))
        while len(self._flying) < len(initial) and self._propose():
            pass
        for k, (_, numbers) in enumerate(points, start=known):
            i, proposal = self._ready[known]
            assert i == k
            del self._ready[known]
            self._told[i] = self._observation(i, proposal, numbers)
        self._move_on()

    def _require_in_range(self, point: Mapping[str, Any]) -> None:
        """Its waveform would be that of another point, which its result does not belong to."""
        for c in self._problem.space.coordinates:
            value, rounding = float(point[c.name]), 1e-9 * (c.most - c.least)
            if not c.least - rounding <= value <= c.most + rounding:
                raise BenchError(
                    f"{c.name} of a point is {value:g}; it must lie in [{c.least:g}, {c.most:g}], the range of this "
                    "search. Nothing was ingested"
                )

    def _identity(self, result: Mapping[str, Any]) -> int:
        """The `_id` of a result; frameworks that keep points in tables give it back as a float."""
        value = result["_id"]
        if isinstance(value, float | np.floating) and float(value).is_integer():
            return int(value)
        return value if isinstance(value, int) else int(value) if isinstance(value, np.integer) else -1

    def _numbers(self, place: int, result: Mapping[str, Any]) -> dict[str, float]:
        """What an observation takes of a result; raises ValueError for one that cannot be taken."""
        if not isinstance(result, Mapping):
            raise ValueError(f"result {place} is {result!r}; it must be a mapping of names to values")
        if self._objective not in result:
            raise ValueError(
                f"result {place} (_id {result.get('_id')}) has no {self._objective}; give NaN where its evaluation "
                "failed. Nothing was ingested"
            )
        found = {}
        for name in (self._objective, *MORE):
            try:
                found[name] = float(result.get(name, math.nan))
            except (TypeError, ValueError) as e:
                raise ValueError(
                    f"result {place} (_id {result.get('_id')}): {name} is {result[name]!r}, no number. Nothing was "
                    "ingested"
                ) from e
        return found

    def _observation(self, i: int, proposal: Proposal, numbers: Mapping[str, float]) -> Observation:
        g, p_nc = numbers[self._objective], numbers["p_nc"]
        return Observation(
            index=i,
            wave=next(w.index for w in self._waves if w.start <= i < w.stop),
            waveform=proposal.waveform,
            origin=proposal.origin,
            n_switches=proposal.n_switches,
            g_cm_s=g,
            rank_cm_s=rank_cm_s(g, p_nc, self._problem.config.objective.max_open),
            failed=not math.isfinite(g),
            beliefs=proposal.surrogate,
            **{name: float(numbers[name]) for name in MORE},  # type: ignore[arg-type]
        )

    def _point(self, waveform: Waveform) -> dict[str, Any]:
        space = self._problem.space
        unit: FloatArray = space.unit(waveform, clip=True)
        point: dict[str, Any] = {c.name: float(c.value(u)) for c, u in zip(space.coordinates, unit, strict=True)}
        constants = {name: constant.value for name, constant in (self.vocs.constants or {}).items()}
        return point | constants


def _is_unnamed(result: Mapping[str, Any]) -> bool:
    """Whether a result is of a point of somebody else's: without `_id`, or with NaN, as a table has it."""
    value = result.get("_id")
    return value is None or (isinstance(value, float | np.floating) and math.isnan(value))
