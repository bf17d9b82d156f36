"""Owns, from Python, what looks after stores and lots: init, status, populations, verify, submit, tls."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softclose_workflows.api.results import Result, Store, path_text
from softclose_workflows.tell.standing import Standing, read_standing

if TYPE_CHECKING:
    from softclose_store import Report
    from softclose_workflows.run.submission import Submission


def init(file: str | os.PathLike[str] | None = None, *, force: bool = False, **answers: Any) -> str:
    """Write a commented campaign file for a switch of one's own, as `softclose init`; nothing is asked.

    Parameters
    ----------
    file
        A .toml file to write; None: only its text is given back.
    force
        Replace an existing file.
    **answers
        name, population, n_pulses, max_volts, min_rise_us, max_open and effort (try, usual, thorough), as far as they
        are not to have their defaults.

    Returns
    -------
    str
        The text of the file.

    Raises
    ------
    OutputError
        Where the file exists already, or cannot be written.
    """
    from softclose_workflows.analyses.starting import Start, starting_file
    from softclose_workflows.tell.outputs import OutputError, check_file, write_text

    target = None if file is None else check_file(os.fspath(file), "file", [".toml"])
    if target is not None and Path(target).exists() and not force:
        raise OutputError(f"{target} exists already: give another name, or force=True to replace it")
    text = starting_file(Start(**answers))
    if target is not None:
        write_text(target, text, "file")
    return text


def status(store: Store) -> Standing:
    """Where a campaign stands, as `softclose status`: candidates, failures, the best."""
    return read_standing(path_text(store))


def populations(names: Sequence[str] = ()) -> Result[dict[str, dict[str, Any]]]:
    """Describe populations, shipped ones or files, as `softclose populations`: one row a number of theirs."""
    from softclose.population import load_population, population_names

    found: dict[str, dict[str, Any]] = {n: dict(load_population(n).summary()) for n in names or population_names()}
    keys = dict.fromkeys(key for summary in found.values() for key in summary)
    rows = [{"number": key, **{name: summary.get(key, "") for name, summary in found.items()}} for key in keys]
    return Result(value=found, title=", ".join(found), rows=rows)


def verify(store: Store, *, repair: bool = False) -> Report:
    """Check that a store holds what was written, as `softclose verify`.

    Parameters
    ----------
    store
        Path, URL, or what `run` returned.
    repair
        Compute damaged parts again.

    Returns
    -------
    Report
        `ok`, and `problems`; after a repair what it left.
    """
    from softclose_store import repair as repair_store
    from softclose_store import verify as verify_store
    from softclose_workflows.analyses.recompute import recompute

    path = path_text(store)
    return repair_store(path, recompute()).after if repair else verify_store(path)


def submit(
    source: str,
    store: Store,
    cluster: str,
    *,
    settings: Sequence[str] = (),
    walltime: str = "24:00:00",
    memory: str = "4G",
    turns: int = 100,
    dry_run: bool = False,
) -> tuple[Submission, str | None]:
    """Run a campaign as a job of a batch scheduler, as `softclose submit`.

    Parameters
    ----------
    source
        A preset or a TOML file.
    store
        Where the campaign is kept.
    cluster
        The TOML file of the workers' jobs.
    settings
        `section.key=value` each.
    walltime
        Of the driver's job.
    memory
        Of the driver's job.
    turns
        Jobs that go on where the one before ended.
    dry_run
        Write and start nothing.

    Returns
    -------
    (Submission, str or None)
        What would be submitted, and the number of the job.
    """
    from softclose.settings import load_config
    from softclose_workflows.run.executors.cluster_file import load_cluster
    from softclose_workflows.run.submission import DriverJob, submission
    from softclose_workflows.run.submission import submit as submit_job

    load_config(source, settings)
    path = path_text(store)
    arguments = ["run", source, "--store", path, "--cluster", cluster, "--quiet"]
    for setting in settings:
        arguments += ["--set", setting]
    job = DriverJob(walltime=walltime, memory=memory, turns=turns)
    planned = submission(path, arguments, load_cluster(cluster), job)
    return planned, None if dry_run else str(submit_job(planned))


def tls(folder: str | os.PathLike[str]) -> Path:
    """Make a TLS certificate for a Dask cluster of your own, as `softclose tls`; export DASK_CONFIG=that folder."""
    from softclose_workflows.run.certificates import make_certificates

    return Path(make_certificates(os.fspath(folder)).folder)
