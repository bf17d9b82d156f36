"""Owns the live view of a campaign, `status --watch`: read from the store alone, whoever writes it and wherever."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING, Any

import numpy as np

from softclose_store import Campaign, lock_holder, open_campaign
from softclose_workflows.tell.standing import stored_open_warning

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

RECENT = 20
"""Waves that the rate and the time left are taken from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """A campaign at one instant, as the live view shows it."""

    name: str
    """The campaign's title."""
    committed: int
    """Committed candidates."""
    budget: int
    """Candidates in all."""
    failed: int
    """Committed candidates without a usable result."""
    best: str
    """Best g with its interval, in words."""
    rate_per_s: float
    """Switches per second over the last candidates; NaN before the second one."""
    left_s: float
    """Time left at that pace [s]; NaN where there is none."""
    workers: int | None
    """Worker processes of the last run; None where the store does not say."""
    driver: str
    """Who drives the campaign now; empty where nobody does."""

    @property
    def finished(self) -> bool:
        """True where the whole budget is committed."""
        return self.committed >= self.budget


def pace(committed_at_s: Any, n_switches: Any, wave: Any, n_left: int) -> tuple[float, float]:
    """(switches per second, seconds left) from the last waves: instant of each commit, its switches, its wave.

    All (n,), the oldest first. The candidates of a wave share an instant; the time since the wave before is theirs. A
    pause between two runs lies in one of the gaps, so gaps count by their median.
    """
    at, sizes, waves = (np.asarray(values, dtype=float) for values in (committed_at_s, n_switches, wave))
    first = np.flatnonzero(np.diff(waves, prepend=np.nan) != 0)[-RECENT:]
    if first.size < 2:
        return math.nan, math.nan
    gaps = np.maximum(np.diff(at[first]), 1e-6)
    n_candidates = np.diff([*first[1:], len(at)])
    n_simulated = np.add.reduceat(sizes, first)[1:]
    return float(np.median(n_simulated / gaps)), n_left * float(np.median(gaps / n_candidates))


def read_view(campaign: Campaign) -> View:
    """The view of a campaign as last refreshed."""
    records = campaign.records()
    n_left = campaign.budget - campaign.committed
    rate, left = pace(records["wall_committed_unix_s"], records["n_switches"], records["wave"], n_left)
    runs = campaign.runtime.get("runs") or [{}]
    holder = lock_holder(campaign.path)
    return View(
        name=str(campaign.config["campaign"]["name"]),
        committed=campaign.committed,
        budget=campaign.budget,
        failed=int(records["failed"].sum()),
        best=_best(campaign),
        rate_per_s=rate,
        left_s=left if n_left and holder is not None else math.nan,
        workers=runs[-1].get("workers"),
        driver="" if holder is None else str(holder),
    )


def _best(campaign: Campaign) -> str:
    from softclose_workflows.tell.tables import with_interval

    best = campaign.best()
    if best is None:
        return "none yet"
    lower, upper = float(best.record["g_lower_cm_s"]), float(best.record["g_upper_cm_s"])
    return f"{with_interval(best.g_cm_s, lower, upper)} cm/s, candidate {best.candidate}{_open(campaign, best.p_nc)}"


def _open(campaign: Campaign, p_nc: float) -> str:
    return f", WARNING: {100.0 * p_nc:.1f} % left open" if stored_open_warning(campaign.config, p_nc) else ""


def one_line(view: View) -> str:
    """For logs and pipes."""
    parts = [f"{view.committed:,} of {view.budget:,} candidates", f"best g {view.best}"]
    if not math.isnan(view.rate_per_s):
        parts.append(f"{view.rate_per_s:,.0f} switches/s")
    if not math.isnan(view.left_s):
        parts.append(f"{_duration(view.left_s)} left")
    if view.failed:
        parts.append(f"{view.failed} failed")
    if not view.finished and not view.driver:
        parts.append("nobody drives it")
    return " · ".join(parts)


def panel(view: View) -> RenderableType:
    """For terminals."""
    from rich.panel import Panel
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    table.add_row("", ProgressBar(total=max(view.budget, 1), completed=view.committed, width=40))
    table.add_row(
        "candidates", f"{view.committed:,} of {view.budget:,} ({100.0 * view.committed / max(view.budget, 1):.0f} %)"
    )
    table.add_row("best g", view.best)
    table.add_row("rate", "–" if math.isnan(view.rate_per_s) else f"{view.rate_per_s:,.0f} switches/s")
    table.add_row("time left", "–" if math.isnan(view.left_s) else _duration(view.left_s))
    table.add_row("workers", "–" if view.workers is None else str(view.workers))
    table.add_row("failed", str(view.failed), style="bold red" if view.failed else None)
    if view.driver:
        table.add_row("driver", view.driver)
    elif not view.finished:
        table.add_row("driver", "none: `softclose resume STORE` continues", style="yellow")
    return Panel(table, title=Text(view.name), title_align="left", subtitle="Ctrl-C ends the view, not the run")


def _duration(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))


def views(path: str, interval_s: float, sleep: Callable[[float], None] = time.sleep) -> Iterator[View]:
    """The view now and every interval_s again; ends after the one that shows the campaign finished."""
    campaign = open_campaign(path)
    while True:
        view = read_view(campaign)
        yield view
        if view.finished:
            return
        sleep(interval_s)
        campaign.refresh()


def watch(path: str, interval_s: float, console: Console) -> None:
    """Show the campaign until it is finished or Ctrl-C: live on a terminal, else one line per change."""
    from rich.live import Live

    try:
        if console.is_terminal:
            with Live(console=console, auto_refresh=False) as live:
                for view in views(path, interval_s):
                    live.update(panel(view), refresh=True)
        else:
            last = ""
            for view in views(path, interval_s):
                if (line := one_line(view)) != last:
                    console.print(line, soft_wrap=True)
                last = line
    except KeyboardInterrupt:
        return
