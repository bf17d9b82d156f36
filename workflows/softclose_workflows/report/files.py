"""Owns writing what a person asked for: whole files or none, names from the store's, one line that says where."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import click


class OutputError(ValueError):
    """An output that cannot be written."""


def default_name(store: str, suffix: str) -> str:
    """`runs/a.zarr` -> `a.html`, in the current folder: a store may be a URL, or read-only."""
    stem = PurePosixPath(store.rstrip("/").replace("\\", "/")).name
    return (stem.removesuffix(".zarr") or "campaign") + suffix


def write_text(path: str, text: str) -> None:
    """Write through a temporary file beside it, so that a reader never sees half a page."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str, content: bytes) -> None:
    """Whole or not at all. Raises OutputError where the folder is missing or may not be written."""
    target = Path(path)
    if target.is_dir():
        raise OutputError(f"{path} is a folder; give the name of a file (-o FILE)")
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            umask = os.umask(0)
            os.umask(umask)
            os.chmod(temporary, 0o666 & ~umask)  # mkstemp's own 0600 would keep colleagues out
            os.replace(temporary, target)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as e:
        raise OutputError(f"cannot write {path}: {e.strerror or e}; choose another place with -o") from e


def say_written(paths: Sequence[str]) -> None:
    """`written: a.html (7.1 MB)`."""
    for path in paths:
        size = Path(path).stat().st_size
        click.echo(f"written: {path} ({size / 1e6:.1f} MB)" if size > 1e5 else f"written: {path} ({size / 1e3:.0f} kB)")
