"""Owns how a running campaign shows that it is alive: a bar on a terminal, a line a minute in a log."""

from __future__ import annotations

import contextlib
import math
import sys
import time
from collections.abc import Iterator

from softclose_workflows.run.campaign import Listener, Progress
from softclose_workflows.terminal import Minutely, plain_console

NARROW = 140
"""Columns below which a bar leaves out the rate and the workers."""


@contextlib.contextmanager
def show_progress(*, quiet: bool) -> Iterator[Listener | None]:
    """A bar that moves with every block, with best g so far and the rate; without a terminal a line a minute on
    standard error; nothing at all where quiet."""
    if quiet:
        yield None
        return
    started = time.monotonic()
    if not sys.stderr.isatty():
        log = Minutely()
        yield lambda p: log.say(lambda: line(p, time.monotonic() - started))
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    console = plain_console(stderr=True)
    narrow = console.width < NARROW
    times = [TextColumn("left"), TimeRemainingColumn()]
    with Bar(
        TextColumn("{task.description}"),
        BarColumn(bar_width=14 if narrow else 20),
        MofNCompleteColumn(),
        TextColumn("{task.fields[state]}"),
        *(times if narrow else [TimeElapsedColumn(), *times]),
        console=console,
    ) as bar:
        task = bar.add_task("starting", total=None, state="")

        def listener(p: Progress) -> None:
            words = words_of(p, time.monotonic() - started)
            state = " · ".join(words[:1] if narrow else words)
            bar.update(task, description=p.stage, completed=p.simulated, total=p.budget, state=state)

        yield listener


def words_of(p: Progress, seconds: float) -> list[str]:
    """The best g so far, the rate, the workers; before the first result what is waited for."""
    if not p.n_switches_done:
        words = ["compiling (first run only)"]
    else:
        words = [f"best g {p.best_g_cm_s:.2f} cm/s"] if math.isfinite(p.best_g_cm_s) else []
        words.append(f"{p.n_switches_done / max(seconds, 1e-3):,.0f} switches/s")
    lost = f"{p.n_retries:,} worker{'s' * (p.n_retries != 1)} lost"
    return [*words, f"{p.n_workers:,} worker{'s' * (p.n_workers != 1)}", *([lost] if p.n_retries else [])]


def line(p: Progress, seconds: float) -> str:
    """`explore: 640 of 1,600 candidates · best g 15.20 cm/s · 210,000 switches/s · 2 workers`."""
    return " · ".join([f"{p.stage}: {p.simulated:,} of {p.budget:,} candidates", *words_of(p, seconds)])
