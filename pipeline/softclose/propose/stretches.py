"""Owns what workers can be asked about a prior: waveforms, or stretches: several generations of one descent, which a
worker runs without asking anybody in between.

What is proposed is never taken from one: a stretch only says what the waveforms that a descent asks for are worth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from softclose.propose.following import Sharing, as_told
from softclose.propose.promises import PriorValues
from softclose.propose.protocol import Problem
from softclose.waveform import Waveform

WORTH = 32_768
"""Trajectories of a stretch, about: a tenth of a second of the kernel, beside which a message is little."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretch:
    """What a worker needs to know of a descent to run it on."""

    descent: Sharing
    n_generations: int
    """How many come next."""
    n_switches: int
    """Of the prior, under each waveform."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Generation:
    """What the prior says of one generation."""

    key: bytes
    """Which waveforms, see `key_of`."""
    values: PriorValues


UNHURRIED = 4
"""How many times as long stretches are where every descent has a worker of its own: there is nothing to balance."""


def length(trajectories: int, left: int, *, is_dealt: bool) -> int:
    """Generations of a stretch, of those that are left: equal parts of about as many trajectories as are worth it.

    trajectories: of one generation; is_dealt: whether there are more descents than workers.
    """
    parts = max(round(left * trajectories / (WORTH if is_dealt else UNHURRIED * WORTH)), 1)
    return -(-left // min(parts, left))


def key_of(waveforms: Sequence[Waveform]) -> bytes:
    """What identifies waveforms, bit for bit."""
    return b"".join(w.rows().tobytes() for w in waveforms)


def run_stretch(
    problem: Problem, values: Callable[[Sequence[Waveform], int], PriorValues], stretch: Stretch
) -> list[Generation]:
    """Run a descent on: what each generation asks for, and what it is worth.

    problem: of `prior_config`; values: those of the prior. Fewer generations where the descent fails: whoever proposes
    its next one meets that again.
    """
    descent, found = stretch.descent, list[Generation]()
    for _ in range(stretch.n_generations):
        try:
            waveforms = problem.space.waveforms(descent.points(problem))
        except Exception:
            problem.descents.clear()
            break
        found.append(Generation(key=key_of(waveforms), values=values(waveforms, stretch.n_switches)))
        descent = descent.after(as_told(found[-1].values.g_cm_s))
    return found


@runtime_checkable
class Asking(Protocol):
    """Who evaluates waveforms beside whoever asks: by workers."""

    @property
    def n_elsewhere(self) -> int:
        """How many processes evaluate."""
        ...

    def begin(self, waveforms: Sequence[Waveform], n_switches: int, *, beside: int = 1) -> Any:
        """Ask; the answer is waited for by what this returns. beside: questions as large that are asked together."""
        ...

    def wait(self, question: Any) -> PriorValues:
        """The answer."""
        ...

    def begin_stretch(self, stretch: Stretch) -> Any:
        """Have a worker run a descent on; the answer is waited for by what this returns."""
        ...

    def wait_stretch(self, question: Any) -> Sequence[Generation]:
        """What each generation asked for, and what it is worth (`run_stretch`)."""
        ...
