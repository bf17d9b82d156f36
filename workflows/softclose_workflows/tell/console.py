"""Owns the terminal: a console that folds nothing in a pipe, and the signs of life of commands that take time.

Progress goes to standard error, and only to a terminal: what a command prints is its result.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

Step = Callable[[int, int], None]
"""Called with what is done and what there is."""


def wide_console(width: int = 160) -> Console:
    """A console that folds no table in a pipe or a log, which have no width of their own."""
    from rich.console import Console

    console = Console(highlight=False)
    return console if console.is_terminal else Console(width=width, highlight=False)


def silent(quiet: bool) -> bool:
    """True where progress is not wanted, or nobody looks."""
    return quiet or not sys.stderr.isatty()


@contextlib.contextmanager
def bar(title: str, *, quiet: bool = False) -> Iterator[Step | None]:
    """A bar that is gone at the end; None where silent."""
    if silent(quiet):
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(title, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


@contextlib.contextmanager
def working(what: str, *, quiet: bool) -> Iterator[None]:
    """A spinner where nothing can be counted; nothing where silent."""
    if silent(quiet):
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(f"{what} …"):
        yield
