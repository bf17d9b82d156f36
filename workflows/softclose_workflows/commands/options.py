"""Owns the options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

Command = TypeVar("Command", bound=Callable[..., Any])


def executor_options(command: Command) -> Command:
    """--workers, --scheduler and --serial."""
    for option in (
        click.option("--serial", is_flag=True, help="Compute in this process, without Dask (for debugging)."),
        click.option("--scheduler", metavar="ADDRESS", help="Use an existing Dask scheduler, e.g. tcp://host:8786."),
        click.option("--workers", type=int, metavar="N", help="Worker processes of the local cluster [one per core]."),
    ):
        command = option(command)
    return command


def quiet_option(command: Command) -> Command:
    """--quiet."""
    return click.option("--quiet", "-q", is_flag=True, help="No progress; only the result.")(command)


def break_lock_option(command: Command) -> Command:
    """--break-lock."""
    return click.option(
        "--break-lock", is_flag=True, help="Take the store over from a driver that you know to be dead elsewhere."
    )(command)
