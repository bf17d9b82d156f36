"""A SLURM of the tests' own on this machine: its daemons, its folder, its jobs; nothing of the machine's is touched."""

from __future__ import annotations

import contextlib
import getpass
import os
import secrets
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch")

_CONF = """\
ClusterName=softclose
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdParameters=config_overrides
SchedulerParameters=sched_interval=1,batch_sched_delay=0
ReturnToService=2
KillWait=5
MinJobAge=60
MpiDefault=none
NodeName={host} NodeAddr=127.0.0.1 CPUs=16 RealMemory=64000 State=UNKNOWN
PartitionName=main Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Slurm:
    """A running SLURM."""

    folder: Path
    environment: dict[str, str]

    def ask(self, *command: str) -> str:
        """What one of its commands prints."""
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True, env=self.environment)
        return done.stdout.strip()

    def jobs(self, name: str = "", states: str = "RUNNING") -> list[str]:
        """Numbers of the jobs in these states, those of a name only where one is given."""
        named = ["--name", name] if name else []
        return self.ask("squeue", "--noheader", "--format=%A", "--states", states, *named).split()


def _free_ports(n: int) -> list[int]:
    with contextlib.ExitStack() as stack:
        found = [stack.enter_context(socket.socket()) for _ in range(n)]
        for s in found:
            s.bind(("127.0.0.1", 0))
        return [s.getsockname()[1] for s in found]


@contextlib.contextmanager
def running_slurm(folder: Path) -> Iterator[Slurm]:
    """Start munge, the controller and one node of 16 stated CPUs; stop them, and every job, at the end."""
    for name in ("state", "spool"):
        (folder / name).mkdir()
    folder.chmod(0o755)  # munge wants its socket's folder readable
    key = folder / "munge.key"
    key.write_bytes(secrets.token_bytes(64))
    key.chmod(0o400)
    host = socket.gethostname().partition(".")[0]
    conf = folder / "slurm.conf"
    conf.write_text(_CONF.format(host=host, folder=folder, user=getpass.getuser(), ports=_free_ports(2)))
    environment = os.environ | {"SLURM_CONF": str(conf)}
    munge = ["munged", "--force", f"--socket={folder}/munge.socket", f"--key-file={key}"]
    munge += [f"--{kind}-file={folder}/munge.{kind}" for kind in ("log", "pid", "seed")]
    daemons = {"munge": munge, "slurmctld": ["slurmctld", "-f", str(conf)], "slurmd": ["slurmd", "-f", str(conf)]}
    slurm = Slurm(folder=folder, environment=environment)
    try:
        for command in daemons.values():
            subprocess.run(command, check=True, timeout=60, env=environment, capture_output=True)
        _wait_until_idle(slurm)
        yield slurm
        for job in slurm.jobs(states="all"):
            subprocess.run(["scancel", "--signal=KILL", "--full", job], env=environment, check=False)
            subprocess.run(["scancel", job], env=environment, check=False)
    finally:
        for name in reversed(daemons):
            with contextlib.suppress(OSError, ValueError):
                os.kill(int((folder / f"{name}.pid").read_text()), signal.SIGTERM)


def _wait_until_idle(slurm: Slurm) -> None:
    end = time.monotonic() + 30.0
    while "idle" not in slurm.ask("sinfo", "--noheader", "--format=%T"):
        assert time.monotonic() < end, (slurm.folder / "slurmctld.log").read_text()
        time.sleep(0.1)
