"""Owns the description of a batch scheduler's cluster: a TOML file, or a name in Dask's own configuration."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Gt
from pydantic import Strict
from pydantic.dataclasses import dataclass

from softclose.allowed.tables import TABLE, Number, checked
from softclose.allowed.types import Text
from softclose.settings import ConfigError, read_toml

Scheduler = Literal["slurm", "pbs", "lsf", "sge", "oar"]

PROJECT_KEY = {"slurm": "account", "pbs": "account", "lsf": "project", "sge": "project", "oar": "project"}
"""What a scheduler's library calls the project that pays."""

AtLeastOne = Annotated[int, Strict(), Ge(1)]

WALLTIME = re.compile(r"(?:(\d+)-)?(?:(\d+):)?(\d+):(\d\d)")
"""Days, hours, minutes and seconds of a walltime."""


@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class Cluster:
    """Jobs of workers under a batch scheduler; Dask's configuration (`jobqueue.NAME`) has what is left out."""

    scheduler: Scheduler = "slurm"
    """Which."""
    config_name: Text | None = None
    """Section of Dask's `jobqueue` configuration that completes this one; by default the scheduler's own."""
    jobs: AtLeastOne = 1
    """Jobs at once."""
    cores: AtLeastOne | None = None
    """Cores of a job: as many workers, of one thread each."""
    memory: Text | None = None
    """Memory of a job, such as "32GB"."""
    walltime: Text | None = None
    """Longest time of a job, `hours:minutes:seconds`. Workers end by themselves before it, and others take over."""
    queue: Text | None = None
    """Queue or partition."""
    project: Text | None = None
    """Account or project that pays."""
    interface: Text | None = None
    """Network interface of scheduler and workers, such as "ib0"."""
    host: Text | None = None
    """Address that the workers reach this process under, where no interface says it."""
    python: Text | None = None
    """Interpreter of the workers; by default this one."""
    prologue: tuple[str, ...] = ()
    """Lines of shell before the workers: modules to load, an environment to activate."""
    directives: tuple[str, ...] = ()
    """More directives of the job's header, such as "--exclusive"."""
    log_folder: Text = "softclose-jobs"
    """Where jobs write their output, and the run its certificates: a folder that all hosts see."""
    wait_s: Annotated[Number, Gt(0.0)] = 86_400.0
    """How long to wait without any worker, as jobs may queue, before stopping [s]."""
    tls: Annotated[bool, Strict()] = True
    """Encrypt and authenticate what workers and scheduler say, by a certificate made for this run."""

    @property
    def walltime_s(self) -> int | None:
        """Seconds of the walltime."""
        if self.walltime is None:
            return None
        found = WALLTIME.fullmatch(self.walltime)
        if found is None:
            raise ConfigError(
                f"cluster: walltime is {self.walltime!r}; it must be hours:minutes:seconds, e.g. 02:00:00"
            )
        days, hours, minutes, seconds = (int(part or 0) for part in found.groups())
        return ((24 * days + hours) * 60 + minutes) * 60 + seconds

    @property
    def lifetime_s(self) -> tuple[int, int] | None:
        """After how long a worker ends by itself, and by how much that is spread [s].

        A tenth of the walltime before its end, from half a minute to five: blocks take seconds, and are computed again
        where one is cut off.
        """
        whole = self.walltime_s
        if whole is None:
            return None
        margin = min(max(whole // 10, 30), 300)
        if whole <= 2 * margin:
            raise ConfigError(f"cluster.walltime is {self.walltime}; workers need more than {2 * margin} s of it")
        return whole - margin, margin // 2


def load_cluster(source: str) -> Cluster:
    """The cluster of a TOML file, or of Dask's configuration under a name. Raises ConfigError naming the problem."""
    if not source.endswith(".toml") and not Path(source).is_file():
        return _configured(source)
    data = read_toml(Path(source))
    inner = data.pop("cluster", None)
    if inner is not None:
        if data:
            raise ConfigError(f"{source}: a cluster's file has one table, [cluster], or its keys alone")
        data = inner
    try:
        return check_cluster(data)
    except ConfigError as e:
        raise ConfigError(f"{source}: {e}") from e


def check_cluster(data: object) -> Cluster:
    """A cluster from plain values. Raises ConfigError naming every problem."""
    cluster = checked(Cluster, data, ConfigError, "[cluster] ")
    _ = cluster.lifetime_s
    return cluster


def _configured(name: str) -> Cluster:
    import dask

    try:
        import dask_jobqueue  # noqa: F401  it brings the defaults of its section
    except ImportError as e:
        raise ConfigError(NO_LIBRARY) from e
    sections = dask.config.get("jobqueue", {})
    if name not in sections:
        raise ConfigError(
            f"no file and no section jobqueue.{name} in Dask's configuration; give a .toml file, or one of "
            f"{', '.join(sorted(sections)) or 'none'}"
        )
    kinds: tuple[str, ...] = Scheduler.__args__  # type: ignore[attr-defined]
    kind = name if name in kinds else sections[name].get("scheduler", "slurm")
    return check_cluster({"scheduler": kind, "config_name": name})


NO_LIBRARY = "a batch scheduler needs dask-jobqueue: pip install dask-jobqueue"
"""What to do where the extra is missing."""
