"""Owns what reaches the terminal: text is text. No markup of rich's, no control characters of a stranger's.

Names, notes and reasons come from files and stores: `[/old]` in one is no end of a style, and an escape sequence no
order to the terminal (its title, its clipboard, a cleared screen). Everything that is printed goes through here.
"""

from __future__ import annotations

import contextlib
import shutil
import sys
import textwrap
import time
import unicodedata
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rich.console import Console

_COMPILED = "the first time, half a minute of compiling kernels"

READING = f"reading the campaign; {_COMPILED}"
"""What `working` says where a configuration is read: prices in proportion to a lot take a simulation of its step."""

STARTING = f"starting what computes; {_COMPILED}"
"""What `working` says until workers, which load the kernels before their first block, are there."""


def visible(text: str) -> str:
    """The text with what would control a terminal, or hide in it, spelt out: `\\x1b[2J`; line ends and tabs stay."""
    if text.isprintable():
        return text
    return "".join(
        c if c in "\n\t" or c.isprintable() or unicodedata.category(c) == "Zs" else c.encode("unicode_escape").decode()
        for c in text
    )


def say(text: object, *, err: bool = False) -> None:
    """Print a line; a terminal gets it folded between words, a pipe or a log as it is."""
    line = visible(str(text))
    if (sys.stderr if err else sys.stdout).isatty():
        line = fitted(line, shutil.get_terminal_size().columns)
    click.echo(line, err=err)


def fitted(text: str, width: int) -> str:
    """Text folded between words to a width; what has no space, such as a path, stays whole."""
    wrapper = textwrap.TextWrapper(width, break_long_words=False, break_on_hyphens=False, replace_whitespace=False)
    lines = []
    for line in text.split("\n"):
        wrapper.subsequent_indent = line[: len(line) - len(line.lstrip())]
        lines.append(wrapper.fill(line) if len(line) > width else line)
    return "\n".join(lines)


class Minutely:
    """Says on standard error how far something is, a line a minute at most, the first after a minute: for logs."""

    def __init__(self, every_s: float = 60.0) -> None:
        self._every_s = every_s
        self._last = time.monotonic()

    def say(self, text: Callable[[], str]) -> None:
        """Print what `text` gives, where a minute has passed since the last line."""
        now = time.monotonic()
        if now - self._last >= self._every_s:
            self._last = now
            say(text(), err=True)


def plain_console_type() -> type[Console]:
    """The class of consoles that take text for text. (A function: rich takes a tenth of a second to import.)"""
    from collections.abc import Iterable

    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.segment import Segment

    class PlainConsole(Console):
        def __init__(self, **options: Any) -> None:
            super().__init__(**({"markup": False, "emoji": False, "highlight": False} | options))

        def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
            for segment in super().render(renderable, options):
                yield segment if segment.control else segment._replace(text=visible(segment.text))

    return PlainConsole


def plain_console(**options: Any) -> Console:
    """A console that takes text for text: rich's own options."""
    return plain_console_type()(**options)


def silent(quiet: bool) -> bool:
    """True where progress is not wanted, or nobody looks."""
    return quiet or not sys.stderr.isatty()


@contextlib.contextmanager
def working(what: str, *, quiet: bool) -> Iterator[None]:
    """A spinner where nothing can be counted; nothing where silent."""
    if silent(quiet):
        yield
        return
    with plain_console(stderr=True).status(f"{what} …"):
        yield
