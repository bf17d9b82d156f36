"""Owns where machine code is cached: where numba can write, else in a folder of one's own, else nowhere.

numba writes beside the source or below the home folder, and refuses to compile at all where it may write neither:
in containers, on nodes with a read-only home, in the jobs of a batch scheduler.
"""

from __future__ import annotations

import os
import stat
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba import njit


def cached_njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit` with its cache wherever one can be had; warns once where that is not beside the source.

    options: those of njit, without `cache`.
    """

    def compile_it(function: Callable[..., Any]) -> Any:
        try:
            return njit(cache=True, **options)(function)
        except RuntimeError as e:  # numba has no exception of its own for it
            if "cannot cache" not in str(e):
                raise
        folder = own_folder()
        if folder is None:
            _warn(f"{tempfile.gettempdir()} neither: kernels are compiled anew by every process, in a minute or so")
            return njit(**options)(function)
        numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
        _warn(f"kernels are kept in {folder}")
        try:
            return njit(cache=True, **options)(function)
        except RuntimeError:
            return njit(**options)(function)

    return compile_it


def own_folder() -> Path | None:
    """A folder for code in the system's temporary one, which its owner alone can write: what lies in it is executed.

    None where it cannot be made, or is somebody else's.
    """
    folder = Path(tempfile.gettempdir()) / f"softclose-kernels-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
    return folder if own and os.access(folder, os.W_OK) else None


_said: set[str] = set()


def _warn(what: str) -> None:
    if what not in _said:
        _said.add(what)
        warnings.warn(
            f"numba can write its cache neither beside the program nor in the home folder; {what} (NUMBA_CACHE_DIR "
            "names another folder)",
            stacklevel=3,
        )
