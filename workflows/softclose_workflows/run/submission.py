"""Owns campaigns whose driver is a job itself: its script queues its own successor until the campaign is done.

The successor is queued first, to start when this job has ended in whatever way (walltime, cancelled, the node gone),
and cancelled last, when there is nothing left to do. SLURM only: it is what the tests can run.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from softclose_workflows.errors import EXIT_STOPPED, ExecutorError
from softclose_workflows.run.executors.cluster_file import WALLTIME, Cluster

WARNING_S = 90
"""How long before its walltime a driver is told to stop [s]: it finishes what is in flight."""

_SCRIPT = """\
#!/bin/bash
{header}
# Written by `softclose submit`. To end the whole chain: scancel --name {name}
set -u
cd {folder}
{prologue}turn=${{SOFTCLOSE_TURN:-1}}
next=
if [ "$turn" -lt {turns} ]; then
  next=$(sbatch --parsable --dependency="afterany:$SLURM_JOB_ID" \\
    --export="ALL,SOFTCLOSE_TURN=$((turn + 1))" {script}) || next=
fi
{command} &
driver=$!
trap 'kill -TERM "$driver"' TERM
wait "$driver"
code=$?
while kill -0 "$driver" 2>/dev/null; do
  wait "$driver"
  code=$?
done
# 0: complete; 1 and 2: it would fail again. Whatever else, the next job resumes.
if [ "$code" -le {last_word} ] && [ -n "$next" ]; then
  scancel "$next"
fi
exit "$code"
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriverJob:
    """The job that a driver runs in."""

    walltime: str = "24:00:00"
    """`hours:minutes:seconds`."""
    memory: str = "4G"
    """As SLURM writes it."""
    turns: int = 100
    """Jobs of one chain at most."""

    def __post_init__(self) -> None:
        if not WALLTIME.fullmatch(self.walltime):
            raise ExecutorError(f"--walltime is {self.walltime!r}; it must be hours:minutes:seconds, as 24:00:00")
        if self.turns < 1:
            raise ExecutorError(f"--turns is {self.turns}; it must be 1 or more")


@dataclass(frozen=True, slots=True, kw_only=True)
class Submission:
    """A script, and where it is to be written."""

    path: Path
    """Script of the driver's job."""
    text: str
    """Its content."""
    name: str
    """Name of every job of the chain."""


def submission(store: str, arguments: Sequence[str], cluster: Cluster, job: DriverJob) -> Submission:
    """The script that runs `softclose` with these arguments until the campaign in store is complete.

    Raises ExecutorError for a scheduler other than SLURM.
    """
    if cluster.scheduler != "slurm":
        raise ExecutorError(
            f"softclose submit knows SLURM; under {cluster.scheduler} submit a script of your own that runs "
            "`softclose run … --cluster FILE`, again until it exits with 0"
        )
    stem = re.sub(r"[^A-Za-z0-9._-]", "-", store.rstrip("/").rpartition("/")[2].removesuffix(".zarr")) or "campaign"
    name = f"softclose-{stem}"
    logs = Path(cluster.log_folder).absolute()
    path = logs / f"{name}.sh"
    header = [
        f"--job-name={name}",
        f"--output={logs}/{name}-%j.log",
        "--open-mode=append",
        "--ntasks=1",
        "--cpus-per-task=1",
        f"--mem={job.memory}",
        f"--time={job.walltime}",
        f"--signal=B:TERM@{WARNING_S}",
    ]
    header += [f"--partition={cluster.queue}"] if cluster.queue else []
    header += [f"--account={cluster.project}"] if cluster.project else []
    command = [cluster.python or sys.executable, "-m", "softclose_workflows", *arguments]
    text = _SCRIPT.format(
        header="\n".join(f"#SBATCH {line}" for line in header),
        name=name,
        folder=shlex.quote(str(Path.cwd())),
        prologue="".join(f"{line}\n" for line in cluster.prologue),
        turns=job.turns,
        script=shlex.quote(str(path)),
        command=shlex.join(command),
        last_word=EXIT_STOPPED - 1,
    )
    return Submission(path=path, text=text, name=name)


def submit(planned: Submission) -> str:
    """Write the script, submit it, and give the job's number. Raises ExecutorError where SLURM refuses."""
    planned.path.parent.mkdir(parents=True, exist_ok=True)
    planned.path.write_text(planned.text, encoding="utf-8")
    planned.path.chmod(0o755)
    try:
        done = subprocess.run(
            ["sbatch", "--parsable", str(planned.path)], capture_output=True, text=True, timeout=60, check=True
        )
    except FileNotFoundError as e:
        raise ExecutorError(f"sbatch is not here; {planned.path} is written: submit it where SLURM is") from e
    except subprocess.SubprocessError as e:
        words = str(getattr(e, "stderr", "") or e).strip()
        raise ExecutorError(f"sbatch refuses {planned.path}: {words}") from e
    return done.stdout.strip().partition(";")[0]
