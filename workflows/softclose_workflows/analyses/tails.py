"""Owns the tail of a stored design: rare failures of its lot by several methods."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from softclose.evaluate.pieces import Mapper, here
from softclose.uncertainty.tails import METHODS, Method, RareEvent, Tail, tail
from softclose_workflows.analyses.chosen import Chosen, choose
from softclose_workflows.tell.plain import finite


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """What is asked of a waveform."""

    event: RareEvent
    limit_cm_s: float

    @property
    def words(self) -> str:
        """`V > 19.7 cm/s`, or `stays open`."""
        return f"V > {self.limit_cm_s:g} cm/s" if self.event == "fast" else "stays open"


def questions(limits_cm_s: Sequence[float], open_: bool) -> list[Question]:
    """One for each limit, and one for switches that stay open."""
    asked = [Question(event="fast", limit_cm_s=limit) for limit in limits_cm_s]
    return [*asked, *([Question(event="open", limit_cm_s=1.0)] if open_ else [])]


def tails(
    path: str,
    asked: Sequence[Question],
    *,
    candidate: int | None = None,
    methods: Sequence[Method] = METHODS,
    n_switches: int = 1_000_000,
    relative_error: float = 0.05,
    seed: int = 0,
    mapper: Mapper = here,
) -> tuple[Chosen, list[tuple[Question, tuple[Tail, ...]]]]:
    """Every method's answer to every question about a candidate, by default the best certified one."""
    chosen = choose(path, candidate)
    found = [
        (
            question,
            tail(
                chosen.config,
                chosen.waveform,
                question.event,
                limit_cm_s=question.limit_cm_s,
                methods=methods,
                n_switches=n_switches,
                relative_error=relative_error,
                confidence=chosen.config.objective.confidence,
                seed=seed,
                mapper=mapper,
            ),
        )
        for question in asked
    ]
    return chosen, found


def to_json(chosen: Chosen, found: Sequence[tuple[Question, tuple[Tail, ...]]]) -> dict[str, Any]:
    """Plain values."""
    rows = [
        {"event": q.event, "limit_cm_s": q.limit_cm_s if q.event == "fast" else None} | asdict(t)
        for q, answers in found
        for t in answers
    ]
    plain: dict[str, Any] = finite({"candidate": chosen.candidate, "tails": rows})
    return plain


def shown(value: float) -> str:
    """`2.0e-06`, `–` where there is none."""
    return "–" if math.isnan(value) else f"{value:.3g}"
