"""Owns how what a person asked for reaches the disk: a whole file under its own name, or none and one clear message."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

import click

from softclose.tables import at_home


class OutputError(ValueError):
    """An output that cannot be written where it was asked for."""


def default_name(store: str, suffix: str) -> str:
    """`runs/a.zarr` -> `a.html`, in the current folder: a store may be a URL, or read-only."""
    stem = PurePosixPath(store.rstrip("/")).name
    return (stem.removesuffix(".zarr") or "campaign") + suffix


def check_file(path: str | Path, option: str = "-o", endings: Sequence[str] = ()) -> Path:
    """The path of a file that can be written, found out before the work is done. Raises OutputError."""
    target = at_home(path)
    if target.is_dir():
        raise OutputError(f"{target} is a folder; give the name of a file ({option})")
    if endings and target.suffix.lower() not in endings:
        raise OutputError(
            f"{target} ends in {target.suffix or 'nothing'}; give a name in {', '.join(endings)} ({option})"
        )
    if not target.parent.is_dir():
        raise OutputError(
            f"{target.parent} is no folder that {target.name} could go to; create it, or give another ({option})"
        )
    if not os.access(target.parent, os.W_OK):
        raise OutputError(f"the folder {target.parent} may not be written; give another ({option})")
    return target


def check_folder(path: str | Path, option: str = "--out") -> Path:
    """The path of a folder that can be made and written, found out before the work is done. Raises OutputError."""
    target = at_home(path)
    there = next(p for p in (target.absolute(), *target.absolute().parents) if p.exists())
    if not there.is_dir():
        raise OutputError(f"{there} is a file; give the name of a folder, new or existing ({option})")
    if not os.access(there, os.W_OK):
        raise OutputError(f"the folder {there} may not be written; give another ({option})")
    return target


def make_folder(path: str | Path, option: str = "--out") -> Path:
    """The folder, made where it is missing. Raises OutputError."""
    target = check_folder(path, option)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as e:
        raise OutputError(f"the folder {target} cannot be made: {e.strerror or e}; give another ({option})") from e
    return target


@contextlib.contextmanager
def whole_file(path: str | Path, option: str = "-o") -> Iterator[Path]:
    """A temporary sibling to write to, renamed to path at the end; removed where anything fails.

    Raises OutputError where the place cannot be written.
    """
    target = check_file(path, option)
    # The suffix stays last: some writers choose the form by it.
    partial = target.with_name(f".{target.stem}.{os.getpid()}.partial{target.suffix}")
    try:
        yield partial
        os.replace(partial, target)
    except OSError as e:
        raise OutputError(
            f"{target} cannot be written: {e.strerror or e}; nothing was left there: give another place ({option})"
        ) from e
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()


def write_text(path: str | Path, text: str, option: str = "-o") -> None:
    """Write one text file whole, with the same line ends everywhere."""
    with whole_file(path, option) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def say_written(paths: Sequence[str | Path], *, err: bool = False) -> None:
    """`written: a.html (7.1 MB)`. err: on standard error, where standard output may be what was asked for."""
    for path in paths:
        size = Path(path).stat().st_size
        digits = 1 if size < 1e4 else 0
        shown = f"{size / 1e6:.1f} MB" if size > 1e5 else f"{size / 1e3:.{digits}f} kB"
        click.echo(f"written: {path} ({shown})", err=err)
