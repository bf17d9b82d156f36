"""Owns how an export reaches the disk: whole, under its own name, or not at all."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path


class ExportError(ValueError):
    """An export that cannot be made as asked; nothing was written."""


@contextlib.contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """A temporary sibling to write to, renamed to target at the end; removed where anything fails.

    Raises ExportError where the place cannot be written.
    """
    if target.is_dir():
        raise ExportError(f"{target} is a folder; give the name of a file (-o)")
    if not target.parent.is_dir():
        raise ExportError(
            f"the folder {target.parent} of {target.name} does not exist; create it, or give another (-o)"
        )
    # The suffix stays last: some writers choose the form by it.
    partial = target.with_name(f".{target.stem}.{os.getpid()}.partial{target.suffix}")
    try:
        yield partial
        os.replace(partial, target)
    except OSError as e:
        raise ExportError(f"{target} cannot be written: {e.strerror or e}; nothing was left there") from e
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()


def write_text(target: Path, text: str) -> None:
    """Write one text file whole, with the same line ends everywhere."""
    with whole_file(target) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")
