"""Owns what a piece of work would take, in memory and on the disk, said before anything is allocated or created.

The figures are measured, and low rather than high: what is refused would not have come to an end.
"""

from __future__ import annotations

import math
import os
import resource
import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from softclose.evaluate.gathered import MOST_BYTES
from softclose.evaluate.realise import n_actuations
from softclose.settings import CampaignConfig
from softclose_workflows.run.actuations import are_kept
from softclose_workflows.run.block_memory import of_worker
from softclose_workflows.run.executors.placement import Placement
from softclose_workflows.run.releases import looks_of

TRAJECTORY_DISK_BYTES, TIME_DISK_BYTES = 60.0, 1.5
"""The same compressed: 1.6 bytes an instant near the optimum, 3 in a search that has just begun."""

RELEASE_FACTOR, FURTHER_MODE_FACTOR = 2.0, 2.4
"""How much more an instant of a release takes than one of a closing (a lot that is let go swings), and one of a further
mode, which swings always: 6.4 and 7.0 bytes where the closing takes 2.9."""

DRIVER_SWITCH_BYTES = 220.0
"""Memory of the driver for each switch of the ensemble, while it is drawn and stored."""

FRESH_SWITCH_BYTES, FRESH_RESPONSE_BYTES, KEPT_RESPONSE_BYTES = 150.0, 30.0, 10.0
"""Memory for each new switch, while one waveform is assessed on it; for each of them under each waveform in a temporary
file until all are assessed, and in memory afterwards."""


LIBRARIES_BYTES = 1.05e9
"""Address space of a process in which nothing but our libraries is loaded and used; below it OpenBLAS, which cannot say
that it has no memory, never comes back."""


class NeedsError(ValueError):
    """Work that this machine cannot hold."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Needs:
    """What a piece of work takes at least."""

    memory_bytes: float
    """Memory on this machine, of all its processes together."""
    disk_bytes: float = 0.0
    """What it will have written at its end."""
    scratch_bytes: float = 0.0
    """What it keeps in temporary files meanwhile."""


def of_run(config: CampaignConfig, *, workers: int, committed: int = 0) -> Needs:
    """A campaign of which `committed` candidates are there already; workers: processes on this machine."""
    few, many = config.campaign.budget + config.explore.budget, config.finish.budget
    trajectories = few * config.population.n_switches + many * config.finish.n_switches
    left = 1.0 - min(committed, config.total_budget) / config.total_budget
    each = TRAJECTORY_DISK_BYTES + motion_bytes(config)
    return Needs(
        memory_bytes=DRIVER_SWITCH_BYTES * config.n_switches_max + workers * of_worker(config),
        disk_bytes=left * (trajectories * config.n_kept_cases * each + n_beside(config) * motion_bytes(config)),
    )


def motion_bytes(config: CampaignConfig) -> float:
    """What x(t) and v(t) of a switch, and of its further modes, take on the disk."""
    modes = 1.0 + FURTHER_MODE_FACTOR * (config.n_modes - 1)
    return TIME_DISK_BYTES * config.store.n_times * modes


def n_beside(config: CampaignConfig) -> float:
    """Trajectories of actuations and tried releases that a campaign keeps, in those of `store.n_times` instants."""
    beside = n_actuations(config) * config.n_switches_max if are_kept(config) else 0.0
    if config.opening.is_designed and config.store.trials:
        switches = min(config.opening.n_switches, config.n_switches_max)
        shorter = len(looks_of(config)) / config.store.n_times
        beside += (1 + config.opening.brake) * switches * config.n_cases * shorter * RELEASE_FACTOR
    return beside


def announced(config: CampaignConfig) -> str:
    """What a campaign will write, before it runs, and where it is much the settings that make it less."""
    size = of_run(config, workers=0).disk_bytes
    said = f"the store will take about {_bytes(size)}"
    if size < MUCH_BYTES:
        return said
    beside = n_beside(config) * motion_bytes(config)
    if beside > 0.5 * size:
        return f"{said}, {100.0 * beside / size:.0f} % of it the motion of trials, which store.trials=false leaves out"
    n_times, motion = config.store.n_times, motion_bytes(config) / (TRAJECTORY_DISK_BYTES + motion_bytes(config))
    return (
        f"{said}, {100.0 * motion:.0f} % of it x(t) and v(t) of every switch at store.n_times={n_times} "
        "instants; fewer of them, or store.max_impacts, make it smaller"
    )


def announced_fresh(config: CampaignConfig, n_switches: int, n_waveforms: int) -> str:
    """What the trajectories behind a certificate will take, before they are simulated."""
    size = motion_bytes(config) * config.n_cases * n_switches * n_waveforms
    return f"the trajectories will take up to {_bytes(size)} in the store"


MUCH_BYTES = 5e8
"""From here on a store's size is worth a thought."""


def of_ensemble(n_switches: int) -> Needs:
    """An ensemble drawn and simulated at once in this process, metrics alone."""
    return Needs(memory_bytes=DRIVER_SWITCH_BYTES * n_switches)


def of_fresh(n_switches: int, n_waveforms: int, *, n_kept: int = 0, kept: CampaignConfig | None = None) -> Needs:
    """Waveforms assessed on new switches; n_kept: further ones, of which the responses stay in memory.

    kept: the campaign, where their trajectories are kept, too.
    """
    per_switch = FRESH_SWITCH_BYTES + KEPT_RESPONSE_BYTES * n_kept
    motion = 0.0 if kept is None else motion_bytes(kept) * kept.n_cases
    return Needs(
        memory_bytes=n_switches * per_switch,
        disk_bytes=(KEPT_RESPONSE_BYTES + motion) * n_switches * n_waveforms,
        scratch_bytes=FRESH_RESPONSE_BYTES * n_switches * n_waveforms,
    )


def of_all(parts: Iterable[Needs]) -> Needs:
    """Work done one after the other."""
    parts = list(parts)
    return Needs(
        memory_bytes=max((p.memory_bytes for p in parts), default=0.0),
        disk_bytes=sum(p.disk_bytes for p in parts),
        scratch_bytes=max((p.scratch_bytes for p in parts), default=0.0),
    )


def check_run(config: CampaignConfig, placement: Placement, path: str, *, committed: int = 0) -> None:
    """Refuse a campaign whose ensemble, blocks or trajectories this machine cannot hold."""
    needs = of_run(config, workers=placement.n_processes, committed=committed)
    n = config.n_switches_max
    check(
        needs,
        f"{config.total_budget:,} candidates of up to {n:,} switches, {config.store.n_times:,} instants each,",
        "lower population.n_switches, finish.n_switches, the budgets or store.n_times, or use fewer workers",
        path=path,
    )


def check_fresh(
    n_switches: int, n_waveforms: int, *, path: str | Path | None = None, kept: CampaignConfig | None = None
) -> None:
    """Refuse an ensemble of new switches that this machine cannot hold; kept: see `of_fresh`."""
    check(
        of_fresh(n_switches, n_waveforms, kept=kept),
        f"{n_waveforms:,} waveforms on {n_switches:,} new switches",
        "lower --switches or --top",
        path=path,
    )


def check(needs: Needs, what: str, remedy: str, *, path: str | Path | None = None) -> None:
    """Raise NeedsError where this machine's memory, or the disk that `path` is on, does not hold it.

    what: names the work, `3,500 candidates of 2,000 switches`; remedy: what to lower. A URL has no disk to look at.
    """
    there = machine_memory_bytes()
    problems = []
    if needs.memory_bytes > there:
        problems.append(f"{_bytes(needs.memory_bytes)} of memory, of which this machine has {_bytes(there)}")
    if path is not None and "://" not in str(path):
        folder = next(p for p in (Path(path).absolute(), *Path(path).absolute().parents) if p.is_dir())
        free = shutil.disk_usage(folder).free
        if needs.disk_bytes > free:
            problems.append(f"{_bytes(needs.disk_bytes)} of disk, of which {_bytes(free)} are free at {folder}")
    if needs.scratch_bytes > MOST_BYTES:
        folder = Path(tempfile.gettempdir())
        free = shutil.disk_usage(folder).free
        if needs.scratch_bytes > free:
            problems.append(
                f"{_bytes(needs.scratch_bytes)} of temporary files, of which {_bytes(free)} are free at {folder} "
                "(TMPDIR names another folder)"
            )
    limit = address_space_bytes()
    if needs.memory_bytes + LIBRARIES_BYTES > limit:
        problems.append(
            f"{_bytes(needs.memory_bytes + LIBRARIES_BYTES)} of address space, of which a process may have "
            f"{_bytes(limit)} (ulimit -v)"
        )
    if problems:
        raise NeedsError(f"{what} would take at least {'; and '.join(problems)}: {remedy}")


def machine_memory_bytes() -> float:
    """Memory of this machine, or of the container or batch job that this process is in."""
    whole = float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    try:
        group = Path("/proc/self/cgroup").read_text(encoding="ascii").rpartition("0::")[2].strip()
        limit = float(Path(f"/sys/fs/cgroup{group}/memory.max").read_text(encoding="ascii"))
    except (OSError, ValueError):  # another system, or no limit ("max")
        return whole
    return min(whole, limit)


def address_space_bytes() -> float:
    """What the shell lets a process address; inf where it sets no limit."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return math.inf if limit == resource.RLIM_INFINITY else float(limit)


def _bytes(n: float) -> str:
    """`1.2 TB`."""
    place = min(max(int(math.log10(max(n, 1.0)) // 3), 0), 6)
    return f"{n / 1000.0**place:.3g} {('B', 'kB', 'MB', 'GB', 'TB', 'PB', 'EB')[place]}"
