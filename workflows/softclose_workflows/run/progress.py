"""Owns the progress bar of a running campaign: on a terminal only."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator

from softclose_workflows.run.campaign import Listener, Progress


@contextlib.contextmanager
def show_progress(*, quiet: bool) -> Iterator[Listener | None]:
    """A bar with best g so far and the rate in switches per second; nothing at all where quiet."""
    if quiet:
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    started = time.monotonic()
    with Bar(
        TextColumn("candidates"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[state]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
    ) as bar:
        task = bar.add_task("run", total=None, state="")

        def listener(p: Progress) -> None:
            rate = p.n_switches_done / max(time.monotonic() - started, 1e-3)
            lost = f" · {p.n_retries} workers lost" if p.n_retries else ""
            state = f"best g {p.best_g_cm_s:.2f} cm/s · {rate:,.0f} switches/s · {p.n_workers} workers{lost}"
            bar.update(task, completed=p.committed, total=p.budget, state=state)

        yield listener
