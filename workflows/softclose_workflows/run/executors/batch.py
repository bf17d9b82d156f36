"""Owns clusters under a batch scheduler: jobs of workers through dask-jobqueue, and others in place of those ended.

Workers end by themselves before their job's walltime. The library notices a job that ended only where it held a single
worker, and never one that ended before its worker came: the scheduler's own list of jobs tells.
"""

from __future__ import annotations

import contextlib
import logging
import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softclose_workflows.errors import ExecutorError, Stopped
from softclose_workflows.run.executors.cluster_file import NO_LIBRARY, PROJECT_KEY, Cluster
from softclose_workflows.run.executors.dask import SILENT, DaskExecutor, configure, on_client
from softclose_workflows.run.faults import MAX_TRIES

if TYPE_CHECKING:
    from dask_jobqueue.core import JobQueueCluster

CLASSES = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "lsf": "LSFCluster",
    "sge": "SGECluster",
    "oar": "OARCluster",
}
"""The library's class for each scheduler."""

LIVE = {
    "slurm": ("squeue", "--noheader", "--me", "--format=%A"),
    "pbs": ("qselect", "-u", "{user}"),
    "lsf": ("bjobs", "-noheader", "-o", "jobid"),
}
"""Commands that list the jobs of a user which queue or run, one number a line."""

LOOK_S = 5.0
"""Least time between two looks at the list of jobs [s]."""

LINES = 5
"""Lines of a failed job's output that are told."""


@contextlib.contextmanager
def batch_cluster(spec: Cluster, patience_s: float) -> Iterator[DaskExecutor]:
    """Workers in jobs, for the length of a `with` block. Raises ExecutorError where no job can be submitted."""
    configure()
    from distributed import Client

    logs = Path(spec.log_folder).absolute()
    try:
        logs.mkdir(parents=True, exist_ok=True)
        cluster = _cluster(spec, logs)
    except (ValueError, TypeError, RuntimeError, OSError) as e:
        raise ExecutorError(f"no cluster of {spec.scheduler} jobs: {e}") from e
    with _closing(cluster):
        jobs = _Jobs(cluster, spec, logs)
        try:
            jobs.settle()
        except (RuntimeError, OSError, ValueError) as e:
            raise ExecutorError(f"{spec.scheduler} takes no job: {_short(e)}") from e
        with Client(cluster, set_as_default=False) as client:
            yield from on_client(client, cluster.dashboard_link, patience_s, jobs, wanted=spec.jobs * (spec.cores or 1))


def job_script(spec: Cluster) -> str:
    """The script that a job of workers is submitted with, but for addresses and names of keys. Raises ExecutorError."""
    from distributed import Security

    logs = Path(spec.log_folder).absolute()
    keys = {name: str(logs / f".{name}") for name in ("tls_ca_file", "tls_worker_cert", "tls_worker_key")}
    place, security = ("tls", Security(**keys)) if spec.tls else ("tcp", None)
    try:
        job = _library(spec).job_cls(f"{place}://SCHEDULER:PORT", "softclose-0", security=security, **_job(spec, logs))
        return str(job.job_script())
    except (ValueError, TypeError, RuntimeError, OSError) as e:
        raise ExecutorError(f"no {spec.scheduler} job: {e}") from e


@contextlib.contextmanager
def _closing(cluster: JobQueueCluster) -> Iterator[JobQueueCluster]:
    """Cancel the jobs and close the scheduler at the end.

    dask-jobqueue never marks its jobs closed, so Dask's close() may raise AssertionError where something, such as an
    error's traceback, still holds one.
    """
    try:
        yield cluster
    finally:
        with contextlib.suppress(AssertionError):
            cluster.close()


def _library(spec: Cluster) -> Any:
    """The library's class of clusters."""
    try:
        import dask_jobqueue
    except ImportError as e:
        raise ExecutorError(NO_LIBRARY) from e
    return getattr(dask_jobqueue, CLASSES[spec.scheduler])


def _job(spec: Cluster, logs: Path) -> dict[str, Any]:
    """What the library is told of a job."""
    options: dict[str, Any] = {
        "cores": spec.cores,
        "processes": spec.cores,
        "memory": spec.memory,
        "interface": spec.interface,
        "python": spec.python,
        "config_name": spec.config_name,
        "queue": spec.queue,
        "walltime": spec.walltime,
        "job_script_prologue": list(spec.prologue) or None,
        "job_extra_directives": list(spec.directives) or None,
        PROJECT_KEY[spec.scheduler]: spec.project,
    }
    extra = ["--no-dashboard"]
    if lifetime := spec.lifetime_s:
        extra += ["--lifetime", f"{lifetime[0]}s", "--lifetime-stagger", f"{lifetime[1]}s"]
    given = {name: value for name, value in options.items() if value is not None}
    return given | {"job_name": "softclose-worker", "log_directory": str(logs), "worker_extra_args": extra}


def _cluster(spec: Cluster, logs: Path) -> JobQueueCluster:
    scheduler: dict[str, Any] = {"dashboard_address": "127.0.0.1:0"}
    if spec.host is not None:
        scheduler["host"] = spec.host
    cluster: JobQueueCluster = _library(spec)(
        **_job(spec, logs),
        shared_temp_directory=str(logs),
        security=True if spec.tls else None,
        scheduler_options=scheduler,
        silence_logs=SILENT,
    )
    return cluster


class _Jobs:
    """Keeps as many jobs as are wanted; called when workers are missing."""

    def __init__(self, cluster: JobQueueCluster, spec: Cluster, logs: Path) -> None:
        self._cluster, self._spec, self._logs = cluster, spec, logs
        self._looked = time.monotonic()
        self._came: set[str] = set()
        """Jobs whose workers have been seen."""
        self._in_vain = 0
        """Jobs in a row that ended before any worker came."""

    def settle(self) -> None:
        """Submit what is missing, and raise what the scheduler refuses with."""
        self._cluster.scale(jobs=self._spec.jobs)

        async def submitted() -> None:
            await self._cluster
            for job in list(self._cluster.workers.values()):
                if job.job_id is None:  # the library keeps a refused job, and its error to itself: once more, then
                    await job

        self._cluster.sync(submitted)

    def __call__(self, wanted: int) -> None:
        """Replace jobs that have ended. Raises Stopped where they end without ever bringing a worker."""
        if time.monotonic() - self._looked < LOOK_S:
            return
        self._looked = time.monotonic()
        jobs = dict(self._cluster.workers)
        here = {name for name in jobs if self._is_here(name)}
        if here - self._came:
            self._in_vain = 0
        self._came |= here
        listed = self._listed()
        gone = [name for name, job in jobs.items() if name not in here and self._has_ended(name, job, listed)]
        if not gone and len(jobs) >= self._spec.jobs:  # the library forgets some jobs itself, and replaces none
            return
        self._in_vain += sum(name not in self._came for name in gone)
        if self._in_vain >= MAX_TRIES:
            raise Stopped(f"{self._in_vain} jobs in a row ended before any worker of theirs came{self._last_words()}")

        async def forget() -> None:
            for name in gone:
                self._cluster.workers.pop(name, None)

        self._cluster.sync(forget)
        try:
            self.settle()
        except (RuntimeError, OSError) as e:  # the scheduler may be down for a while
            self._in_vain += 1
            logging.getLogger(__name__).warning("%s takes no job now: %s", self._spec.scheduler, _short(e))

    def _is_here(self, name: str) -> bool:
        workers = self._cluster.scheduler_info["workers"].values()
        return any(str(w["name"]) == name or str(w["name"]).startswith(f"{name}-") for w in workers)

    def _has_ended(self, name: str, job: Any, listed: set[str] | None) -> bool:
        if job.job_id is None:  # it was never taken
            return True
        return name in self._came if listed is None else str(job.job_id).partition(".")[0] not in listed

    def _listed(self) -> set[str] | None:
        """Numbers of the jobs that queue or run; None where nobody tells."""
        command = LIVE.get(self._spec.scheduler)
        if command is None:
            return None
        words = [word.format(user=os.environ.get("USER", "")) for word in command]
        try:
            done = subprocess.run(words, capture_output=True, text=True, timeout=30, check=True)
        except (OSError, subprocess.SubprocessError):
            return None
        return {line.strip().partition(".")[0] for line in done.stdout.split()}

    def _last_words(self) -> str:
        """The end of what the last job wrote, for who has to find out."""
        found = sorted(self._logs.glob("softclose-worker*"), key=lambda path: path.stat().st_mtime)
        for path in reversed(found):
            lines = path.read_text(encoding="utf-8", errors="replace").strip().splitlines()
            if lines:
                return f"; the last one wrote ({path}): " + " | ".join(lines[-LINES:])
        return f"; look at {self._logs}"


def _short(e: BaseException) -> str:
    """The scheduler's own words of an error that quotes a whole command."""
    text = str(e)
    _, found, after = text.partition("stderr:")
    return " ".join((after if found else text).split())
