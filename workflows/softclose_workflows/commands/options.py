"""Owns the options that several commands share."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import click

Command = TypeVar("Command", bound=Callable[..., Any])


def placement_options(
    command: Callable[..., Any], usual: str = "one per core", *, has_workers: bool = True
) -> Callable[..., Any]:
    """--workers, --scheduler, --cluster, --serial … handed to the command as one `placement`.

    usual: what is used where none of them is given. has_workers: whether that is a local cluster.
    """

    @functools.wraps(command)
    def with_placement(
        *args: Any,
        workers: int | None,
        scheduler: str | None,
        plain_tcp: bool,
        cluster: str | None,
        serial: bool,
        patience: float,
        **options: Any,
    ) -> Any:
        is_local = has_workers and not (scheduler or cluster or serial or options.get("dry_run"))
        if workers is not None or is_local:
            from softclose_workflows.run.forking import start_ahead

            start_ahead()  # before our own imports, which take as long
        from softclose_workflows.run.executors import Placement
        from softclose_workflows.run.executors.cluster_file import load_cluster

        jobs = None if cluster is None else load_cluster(cluster)
        placement = Placement(
            workers=workers,
            scheduler=scheduler,
            plain_tcp=plain_tcp,
            cluster=jobs,
            serial=serial,
            patience_s=patience,
        )
        return command(*args, placement=placement, **options)

    wrapped: Callable[..., Any] = with_placement
    for option in (
        click.option(
            "--patience",
            type=float,
            default=30.0,
            show_default=True,
            metavar="SECONDS",
            help="How long to wait without any worker or scheduler before stopping.",
        ),
        click.option("--serial", is_flag=True, help="Compute in this process, without Dask (for debugging)."),
        click.option(
            "--cluster",
            metavar="FILE",
            help="Start workers as jobs of a batch scheduler (SLURM, PBS, …): a .toml file, or a name in Dask's "
            "configuration.",
        ),
        click.option("--plain-tcp", is_flag=True, help="Use a scheduler on another host without TLS."),
        click.option("--scheduler", metavar="ADDRESS", help="Use an existing Dask scheduler, e.g. tcp://host:8786."),
        click.option("--workers", type=int, metavar="N", help=f"Worker processes of the local cluster [{usual}]."),
    ):
        wrapped = option(wrapped)
    return wrapped


def crew_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options of `placement_options` for a command that uses threads of this process where nothing is said."""
    return placement_options(command, usual="threads of this process, one per core", has_workers=False)


def quiet_option(command: Command) -> Command:
    """--quiet."""
    return click.option("--quiet", "-q", is_flag=True, help="No progress; only the result.")(command)


def break_lock_option(command: Command) -> Command:
    """--break-lock."""
    return click.option(
        "--break-lock", is_flag=True, help="Take the store over from a driver that you know to be dead elsewhere."
    )(command)


def columns_option(example: str) -> Callable[[Command], Command]:
    """--columns."""
    return click.option(
        "--columns",
        metavar="OURS=THEIRS,…",
        help=f"Which column of the table is which, where its heading calls it otherwise: {example}.",
    )
