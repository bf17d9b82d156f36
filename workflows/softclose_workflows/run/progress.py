"""Owns the progress bar of a running campaign: on a terminal only."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator

from softclose_workflows.run.campaign import Listener, Progress


@contextlib.contextmanager
def show_progress(*, quiet: bool) -> Iterator[Listener | None]:
    """A bar that moves with every block, with best g so far and the rate; nothing at all where quiet."""
    if quiet:
        yield None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    from softclose_workflows.terminal import plain_console

    started = time.monotonic()
    with Bar(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[state]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=plain_console(stderr=True),
    ) as bar:
        task = bar.add_task("starting", total=None, state="")

        def listener(p: Progress) -> None:
            rate = p.n_switches_done / max(time.monotonic() - started, 1e-3)
            words = [f"best g {p.best_g_cm_s:.2f} cm/s"] if math.isfinite(p.best_g_cm_s) else []
            words += [f"{rate:,.0f} switches/s"] if p.n_switches_done else ["compiling, first run only"]
            words += [f"{p.n_workers} workers"] + ([f"{p.n_retries} workers lost"] if p.n_retries else [])
            bar.update(task, description=p.stage, completed=p.simulated, total=p.budget, state=" · ".join(words))

        yield listener
