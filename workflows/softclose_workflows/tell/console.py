"""Owns the terminal: a console that folds nothing in a pipe, and the signs of life of commands that take time.

Progress goes to standard error: what a command prints is its result.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from softclose_workflows.terminal import Minutely, plain_console, plain_console_type, silent

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

OnStep = Callable[[int, int], None]
"""Called with what is done and what there is."""


ROOM = 24
"""Columns that a table needs beyond its narrowest form to be easier to read than its rows one below the other."""


def wide_console() -> Console:
    """A console for tables, on standard output.

    In a pipe or a log, which have no width of their own, it folds nothing and ends lines where their text ends. On a
    terminal too narrow for a table it prints each row as a block of its own: what names a row is never cut.
    """
    from rich.table import Table

    class TableConsole(plain_console_type()):  # type: ignore[misc]
        def print(self, *objects: Any, **options: Any) -> None:
            table = objects[0] if len(objects) == 1 else None
            if not self.is_terminal:
                if isinstance(table, Table):
                    self.file.write("".join(f"{line}\n" for line in _unfolded(self, table)))
                else:
                    super().print(*objects, **({"soft_wrap": True} | options))
            elif isinstance(table, Table) and _too_wide(self, table):
                super().print(stacked(table), **options)
            else:
                super().print(*objects, **options)

    console: Console = TableConsole()
    return console


def _unfolded(console: Console, table: Table) -> Iterator[str]:
    """The lines of a table that is as wide as it needs to be, its title above and its caption below it."""
    width = console.measure(table, options=console.options.update(width=_ANY_WIDTH)).maximum
    title, caption = table.title, table.caption
    table.title = table.caption = None
    try:
        lines = console.render_lines(table, console.options.update(width=width), pad=False)
    finally:
        table.title, table.caption = title, caption
    yield from str(title or "").splitlines()
    for line in lines:
        yield "".join(segment.text for segment in line).rstrip()
    yield from str(caption or "").splitlines()


_ANY_WIDTH = 10_000
"""Columns that no table of ours needs."""


def _too_wide(console: Console, table: Table) -> bool:
    needs = console.measure(table, options=console.options.update(width=1000))
    return needs.maximum > console.width and needs.minimum + ROOM > console.width


def stacked(table: Table) -> RenderableType:
    """A table's rows one below the other: its first column as a heading, the others as lines below it."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.table import Table
    from rich.text import Text

    columns = [(column.header, list(column.cells)) for column in table.columns]
    parts: list[RenderableType] = [Text(str(table.title or ""), style="italic")]
    for i, name in enumerate(columns[0][1]):
        lines = Table.grid(padding=(0, 2))
        for header, cells in columns[1:]:
            if cells[i] != "":
                lines.add_row(header, cells[i])
        parts += [Text.assemble((str(name), "bold"))] if name else []
        parts.append(Padding(lines, (0, 0, 0, 2)))
    if table.caption:
        parts.append(Text(str(table.caption), style="dim italic"))
    return Group(*parts)


@contextlib.contextmanager
def bar(title: str, *, quiet: bool = False) -> Iterator[OnStep | None]:
    """A bar that is gone at the end; without a terminal a line a minute, `certifying: 40 %`; None where quiet."""
    if quiet:
        yield None
        return
    if silent(quiet):
        log = Minutely()
        yield lambda done, total: log.say(lambda: f"{title}: {100.0 * done / max(total, 1):.0f} %")
        return
    from rich.progress import Progress

    with Progress(console=plain_console(stderr=True), transient=True) as progress:
        task = progress.add_task(title, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)
