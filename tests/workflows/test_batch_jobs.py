"""Claims about jobs of workers under a batch scheduler: which are replaced, when a run gives up, and what it says."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import io
import logging
import os
import subprocess
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from softclose_workflows.errors import ExecutorError, Stopped
from softclose_workflows.run.executors import batch
from softclose_workflows.run.executors.batch import batch_cluster, job_script
from softclose_workflows.run.executors.cluster_file import check_cluster


class Job:
    """Stands for one of dask-jobqueue's jobs; the scheduler refuses one that has no number."""

    def __init__(self, number: int | None) -> None:
        self.job_id = None if number is None else str(number)
        self.refusal: Exception | None = None
        self.submitted = 0

    def __await__(self) -> Iterator[None]:
        self.submitted += 1
        if self.refusal is not None:
            raise self.refusal
        return iter(())


class Jobs:
    """Stands for dask-jobqueue's cluster and the scheduler's list of jobs, which queue until a worker comes."""

    def __init__(self) -> None:
        self.workers: dict[str, Job] = {}
        self.scheduler_info: dict[str, Any] = {"workers": {}}
        self.listed: set[str] | None = set()
        self.refusals: list[Exception] = []
        self.n = 0

    def scale(self, jobs: int) -> None:
        if self.refusals:
            raise self.refusals.pop(0)
        while len(self.workers) < jobs:
            self.workers[f"softclose-{self.n}"] = Job(100 + self.n)
            if self.listed is not None:
                self.listed.add(str(100 + self.n))
            self.n += 1

    def sync(self, work: Callable[[], Any]) -> None:
        asyncio.run(work())

    def __await__(self) -> Iterator[None]:
        return iter(())

    def arrives(self, i: int) -> None:
        """A worker of job i connects."""
        self.scheduler_info["workers"][f"tcp://{i}"] = {"name": f"softclose-{i}-0"}

    def ends(self, i: int) -> None:
        """Job i ends, and its worker with it."""
        self.scheduler_info["workers"].pop(f"tcp://{i}", None)
        if self.listed is not None:
            self.listed.discard(str(100 + i))


class Watched:
    """What keeps the jobs of a fake cluster, with a clock of its own."""

    def __init__(self, jobs: int, logs: Path, monkeypatch: pytest.MonkeyPatch, scheduler: str = "slurm") -> None:
        self.now = 1024.0
        monkeypatch.setattr(batch, "time", SimpleNamespace(monotonic=lambda: self.now))
        self.cluster = Jobs()
        spec = check_cluster({"scheduler": scheduler, "cores": 1, "memory": "1GB", "jobs": jobs})
        self.keep = batch._Jobs(self.cluster, spec, logs)  # type: ignore[arg-type]
        monkeypatch.setattr(self.keep, "_listed", lambda: self.cluster.listed)
        self.keep.settle()

    def look(self) -> set[str]:
        """Five seconds later: the jobs that are there then."""
        self.now += 5.0
        self.keep(1)
        return set(self.cluster.workers)


def names(*numbers: int) -> set[str]:
    return {f"softclose-{i}" for i in numbers}


def test_a_job_that_queues_is_waited_for_and_one_that_has_ended_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether its worker had come or not."""
    watched = Watched(3, tmp_path, monkeypatch)
    watched.cluster.arrives(0)
    assert watched.look() == names(0, 1, 2)
    watched.cluster.ends(0)
    assert watched.look() == names(1, 2, 3)
    watched.cluster.ends(1)
    assert watched.look() == names(2, 3, 4)


def test_a_job_that_the_library_forgot_by_itself_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(2, tmp_path, monkeypatch)
    del watched.cluster.workers["softclose-0"]
    assert watched.look() == names(1, 2)


def test_the_list_of_jobs_is_asked_for_every_five_seconds_at_most(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watched = Watched(1, tmp_path, monkeypatch)
    watched.cluster.ends(0)
    for _ in range(3):
        watched.now += 1.25
        watched.keep(1)
        assert set(watched.cluster.workers) == names(0)
    watched.now += 1.25
    watched.keep(1)
    assert set(watched.cluster.workers) == names(1)
    watched.cluster.ends(1)
    watched.now += 4.75
    watched.keep(1)
    assert set(watched.cluster.workers) == names(1)


def test_the_third_job_in_a_row_that_ends_without_a_worker_stops_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker that comes begins the count anew; a job that had one ends for a reason of its own."""
    watched = Watched(1, tmp_path, monkeypatch)
    for i in (0, 1):
        watched.cluster.ends(i)
        assert watched.look() == names(i + 1)
    watched.cluster.arrives(2)
    watched.look()
    watched.cluster.ends(2)
    assert watched.look() == names(3)
    for i in (3, 4):
        watched.cluster.ends(i)
        assert watched.look() == names(i + 1)
    watched.cluster.ends(5)
    with pytest.raises(Stopped, match="3 jobs in a row ended before any worker"):
        watched.look()


def test_jobs_that_end_together_are_counted_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(4, tmp_path, monkeypatch)
    for i in (0, 1):
        watched.cluster.ends(i)
    watched.look()
    watched.cluster.ends(2)
    with pytest.raises(Stopped, match="3 jobs in a row"):
        watched.look()


def test_a_worker_that_stays_is_no_sign_that_new_jobs_bring_any(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watched = Watched(2, tmp_path, monkeypatch)
    watched.cluster.arrives(0)
    for i in (1, 2):
        watched.cluster.ends(i)
        assert watched.look() == names(0, i + 1)
    watched.cluster.ends(3)
    with pytest.raises(Stopped, match="3 jobs in a row"):
        watched.look()


@pytest.mark.parametrize("refusal", [RuntimeError("stderr: the controller is away"), OSError("no such program")])
def test_a_scheduler_may_be_away_for_a_while(
    refusal: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Twice; who refuses three times in a row is not asked again."""
    watched = Watched(2, tmp_path, monkeypatch)
    watched.cluster.arrives(0)
    watched.cluster.arrives(1)
    watched.look()
    watched.cluster.ends(0)
    watched.cluster.refusals = [refusal, refusal]
    assert (watched.look(), watched.look()) == (names(1), names(1))
    assert "slurm takes no job now" in caplog.text
    assert watched.look() == names(1, 2)
    watched.cluster.arrives(2)
    watched.look()
    watched.cluster.ends(2)
    watched.cluster.refusals = [refusal] * 9
    for _ in range(3):
        assert watched.look() == names(1)
    with pytest.raises(Stopped):
        watched.look()


def test_a_job_that_was_never_taken_is_submitted_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(2, tmp_path, monkeypatch)
    watched.cluster.workers["softclose-0"].job_id = None
    assert watched.look() == names(1, 2)


def test_a_refusal_that_the_library_keeps_to_itself_is_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(2, tmp_path, monkeypatch)
    first, second = watched.cluster.workers.values()
    first.job_id, first.refusal = None, RuntimeError("invalid partition")
    with pytest.raises(RuntimeError, match="invalid partition"):
        watched.keep.settle()
    assert (first.submitted, second.submitted) == (1, 0), "a job that was taken is not submitted twice"


def test_where_nobody_lists_jobs_only_one_whose_worker_came_and_went_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other may queue for days."""
    watched = Watched(2, tmp_path, monkeypatch, "sge")
    watched.cluster.listed = None
    watched.cluster.arrives(0)
    watched.look()
    watched.cluster.ends(0)
    watched.cluster.ends(1)
    assert watched.look() == names(1, 2)


def test_a_job_is_its_workers_also_where_another_s_name_begins_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """softclose-1 has ended, softclose-10 and -11 have not; a job of one worker has the worker's own name."""
    watched = Watched(12, tmp_path, monkeypatch, "sge")
    watched.cluster.listed = None
    for i in range(12):
        watched.cluster.arrives(i)
    watched.cluster.scheduler_info["workers"]["tcp://5"]["name"] = "softclose-5"
    assert watched.look() == names(*range(12))
    watched.cluster.ends(1)
    assert watched.look() == names(0, *range(2, 13))


def program(folder: Path, name: str, script: str) -> None:
    """A program of that name, in shell."""
    file = folder / name
    file.write_text(f"#!/bin/sh\n{script}\n")
    file.chmod(0o755)


def listed(scheduler: str, monkeypatch: pytest.MonkeyPatch, folder: Path) -> set[str] | None:
    """What the scheduler's own program, found in the folder, says."""
    monkeypatch.setenv("PATH", f"{folder}:/bin:/usr/bin")
    spec = check_cluster({"scheduler": scheduler, "cores": 1, "memory": "1GB"})
    return batch._Jobs(Jobs(), spec, folder)._listed()  # type: ignore[arg-type]


def test_numbers_of_jobs_are_read_from_each_scheduler_s_own_list(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program(tmp_path, "squeue", "echo 12; echo '  13 '")
    program(tmp_path, "qselect", '[ "$2" = ada ] && echo 12.head.example; echo 14.head.example')
    program(tmp_path, "bjobs", "echo 12")
    monkeypatch.setenv("USER", "ada")
    assert listed("slurm", monkeypatch, tmp_path) == {"12", "13"}
    assert listed("pbs", monkeypatch, tmp_path) == {"12", "14"}
    assert listed("lsf", monkeypatch, tmp_path) == {"12"}
    assert listed("sge", monkeypatch, tmp_path) is None


@pytest.mark.parametrize("script", ["echo 12; exit 1", None])
def test_a_list_that_cannot_be_had_says_nothing_about_any_job(
    script: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a controller that is away for a moment would end all of them."""
    if script is None:
        monkeypatch.setitem(batch.LIVE, "slurm", ("no-such-squeue",))
    else:
        program(tmp_path, "squeue", script)
    assert listed("slurm", monkeypatch, tmp_path) is None


def test_a_list_that_never_comes_is_waited_for_less_than_a_minute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(words: list[str], *, timeout: float, **_: object) -> None:
        assert timeout < 60.0
        raise subprocess.TimeoutExpired(words, timeout)

    monkeypatch.setattr(subprocess, "run", run)
    assert listed("slurm", monkeypatch, tmp_path) is None


def test_a_number_is_found_in_the_list_whatever_host_the_library_appends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watched = Watched(1, tmp_path, monkeypatch)
    watched.cluster.workers["softclose-0"].job_id = "100.head.example"
    assert watched.look() == names(0)


def last_words(folder: Path) -> str:
    spec = check_cluster({"cores": 1, "memory": "1GB"})
    return batch._Jobs(Jobs(), spec, folder)._last_words()  # type: ignore[arg-type]


def test_the_last_five_lines_of_the_job_that_wrote_last_are_told(tmp_path: Path) -> None:
    """Whatever its number; an empty file says nothing."""
    assert last_words(tmp_path) == f"; look at {tmp_path}"
    for at, number, text in ((10, 3, "old"), (20, 1, "\n".join("abcdefg") + "\n\n"), (30, 2, " \n")):
        file = tmp_path / f"softclose-worker-{number}.err"
        file.write_text(text)
        os.utime(file, (at, at))
    (tmp_path / "softclose-a.log").write_text("a driver's")
    assert last_words(tmp_path) == f"; the last one wrote ({tmp_path}/softclose-worker-1.err): c | d | e | f | g"


def test_of_an_error_that_quotes_a_command_the_scheduler_s_own_words_are_told() -> None:
    quoted = RuntimeError(
        "Command exited with 1\ncommand:\nsbatch x.sh\nstderr:\nsbatch: error:\n  invalid partition\n"
    )
    assert batch._short(quoted) == "sbatch: error: invalid partition"
    assert batch._short(OSError("no space\nleft")) == "no space left"


ERRORS = [ValueError("no cores"), TypeError("no such option"), RuntimeError("no loop"), OSError("no port")]


@pytest.mark.parametrize("error", ERRORS, ids=lambda e: type(e).__name__)
def test_whatever_the_library_refuses_with_is_an_error_of_ours(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the cluster, of its first jobs, and of the script that is shown."""

    class Refusing(Jobs):
        """Dask-jobqueue's cluster; closed again where its jobs are refused."""

        closed = 0

        def scale(self, jobs: int) -> None:
            raise error

        def close(self) -> None:
            Refusing.closed += 1
            raise AssertionError("a job is not closed")

    def refused(*_: object, **__: object) -> Any:
        raise error

    spec = check_cluster({"cores": 1, "memory": "1GB", "log_folder": str(tmp_path / "jobs")})
    monkeypatch.setattr(batch, "_library", lambda spec: SimpleNamespace(job_cls=refused))
    with pytest.raises(ExecutorError, match=f"no slurm job: {error}"):
        job_script(spec)
    monkeypatch.setattr(batch, "_library", lambda spec: refused)
    with pytest.raises(ExecutorError, match=f"no cluster of slurm jobs: {error}"), batch_cluster(spec, 1.0):
        pass
    if isinstance(error, TypeError):
        return
    monkeypatch.setattr(batch, "_library", lambda spec: lambda **_: Refusing())
    with pytest.raises(ExecutorError, match=f"slurm takes no job: {error}"), batch_cluster(spec, 1.0):
        pass
    assert Refusing.closed == 1


def test_a_log_folder_that_cannot_be_made_is_an_error_of_ours(tmp_path: Path) -> None:
    (tmp_path / "jobs").write_text("a file")
    spec = check_cluster({"cores": 1, "memory": "1GB", "log_folder": str(tmp_path / "jobs")})
    with pytest.raises(ExecutorError, match="no cluster of slurm jobs"), batch_cluster(spec, 1.0):
        pass


@contextlib.contextmanager
def without_workers(folder: Path, monkeypatch: pytest.MonkeyPatch, **more: Any) -> Iterator[tuple[str, int]]:
    """Dask-jobqueue's own cluster, under programs that only note what they are asked for.

    Its scheduler's address, and how many workers its executor is told to wish for.
    """
    program(folder, "sbatch", f'cp "$1" {folder}/$$.script; echo $$')  # several run at once
    program(folder, "scancel", f'echo "$1" >> {folder}/cancelled')
    monkeypatch.setenv("PATH", f"{folder}:/bin:/usr/bin")
    told: list[tuple[str, int]] = []

    def on_client(client: Any, *_: object, wanted: int) -> Iterator[None]:
        told.append((client.scheduler.address, wanted))
        yield

    monkeypatch.setattr(batch, "on_client", on_client)
    with batch_cluster(check_cluster({"memory": "1GB", "log_folder": str(folder / "jobs"), **more}), 1.0):
        yield told[0]
    with warnings.catch_warnings():  # the library closes the files of its keys when it is collected
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()


def test_all_jobs_are_submitted_at_first_and_cancelled_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their workers get keys of this run alone, where they can read them; nothing of Dask's is logged meanwhile."""
    shown = logging.StreamHandler(io.StringIO())
    monkeypatch.setattr(logging.getLogger("distributed"), "handlers", [shown])
    with without_workers(tmp_path, monkeypatch, jobs=3, cores=2, host="127.0.0.1") as (address, wanted):
        assert wanted == 6
        taken = {file.stem: file.read_text() for file in tmp_path.glob("*.script")}
        assert len(taken) == 3
        assert address.startswith("tls://127.0.0.1:")
        assert all(address in script and f"--tls-key {tmp_path}/jobs/" in script for script in taken.values())
        logging.getLogger("distributed.batched").critical("a page of it")
        assert shown.stream.getvalue() == ""
    assert sorted((tmp_path / "cancelled").read_text().split()) == sorted(taken)


def test_what_a_cluster_does_not_say_is_taken_from_dask_s_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of cores that it does not say, one worker a job is wished for; keys are only left out where it says so."""
    import dask

    with (
        dask.config.set({"jobqueue.slurm.cores": 4, "jobqueue.slurm.interface": "lo"}),
        without_workers(tmp_path, monkeypatch, jobs=2, tls=False) as (address, wanted),
    ):
        assert wanted == 2
        assert address.startswith("tcp://127.0.0.1:")
        for file in tmp_path.glob("*.script"):
            assert "--cpus-per-task=4" in file.read_text()
            assert "--tls-key" not in file.read_text()
