"""Owns where a command computes: in this process, on a local cluster, or on a scheduler somewhere."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass

from softclose_workflows.errors import ExecutorError
from softclose_workflows.run.executors.cluster_file import Cluster
from softclose_workflows.run.executors.dask import configure, local_cluster, remote_cluster
from softclose_workflows.run.executors.protocol import Executor
from softclose_workflows.run.executors.serial import SerialExecutor
from softclose_workflows.run.executors.threads import ThreadExecutor

PATIENCE_S = 30.0
"""How long a run waits without any worker, or without its scheduler, before it stops [s]; `--patience`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """Where a command computes; the options --workers, --scheduler, --cluster, --serial, …"""

    workers: int | None = None
    """Processes of a local cluster; None: one per core."""
    cluster: Cluster | None = None
    """Jobs of a batch scheduler, instead of a local cluster."""
    scheduler: str | None = None
    """Address of an existing Dask scheduler, instead of a local cluster."""
    serial: bool = False
    """In this process, without Dask."""
    plain_tcp: bool = False
    """Use a scheduler on another host without TLS."""
    patience_s: float = PATIENCE_S
    """How long to wait without any worker or scheduler [s]."""

    def __post_init__(self) -> None:
        if self.workers is not None and (not isinstance(self.workers, int) or self.workers < 1):
            raise ExecutorError(f"--workers is {self.workers!r}; it must be a whole number from 1 on")
        if not self.patience_s > 0:
            raise ExecutorError(f"--patience is {self.patience_s:g}; it must be a number of seconds above 0")
        chosen = [self.workers is not None, self.scheduler is not None, self.cluster is not None, self.serial]
        if sum(chosen) > 1:
            raise ExecutorError("--workers, --scheduler, --cluster and --serial exclude each other; give one of them")

    @property
    def is_usual(self) -> bool:
        """True where nothing is said of where to compute."""
        return self.workers is None and self.scheduler is None and self.cluster is None and not self.serial

    @property
    def wait_s(self) -> float:
        """How long a run waits without any worker [s]: jobs may queue."""
        return self.patience_s if self.cluster is None else max(self.cluster.wait_s, self.patience_s)

    @property
    def n_processes(self) -> int:
        """Processes on this machine that compute; none where a scheduler has its own."""
        return (
            0
            if self.scheduler is not None or self.cluster is not None
            else 1
            if self.serial
            else self.workers or n_cores()
        )


@contextlib.contextmanager
def open_executor(placement: Placement, *, threads: int | None = None) -> Iterator[Executor]:
    """An executor for the length of a `with` block. Raises ExecutorError where it cannot be started.

    threads: so many of this process, where the placement names nothing else; None: a local cluster then.
    """
    if placement.serial or (threads == 1 and placement.is_usual):
        yield SerialExecutor()
    elif threads is not None and placement.is_usual:
        pool = ThreadExecutor(threads)
        try:
            yield pool
        finally:
            pool.close()
    elif placement.scheduler is not None:
        with remote_cluster(placement.scheduler, placement.patience_s, plain_tcp=placement.plain_tcp) as executor:
            yield executor
    elif placement.cluster is not None:
        from softclose_workflows.run.executors.batch import batch_cluster

        with batch_cluster(placement.cluster, placement.wait_s) as executor:
            yield executor
    else:
        with local_cluster(placement.n_processes, placement.patience_s) as executor:
            yield executor


def prepare_to_open(placement: Placement) -> None:
    """Import what an executor needs, so that other imports may go on beside its start."""
    if not placement.serial:
        configure()


def n_cores() -> int:
    """Cores that this process may use."""
    # macOS has no affinities.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
