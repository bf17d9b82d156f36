"""Owns the outcomes that end a command early, and their exit codes.

0: done; 1: a store is damaged; 2: bad input, nothing was changed; 3: stopped before the end, nothing committed is lost,
`resume` continues; 4: the waveform misses a limit of `sign`.
"""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator

EXIT_DAMAGED = 1
EXIT_BAD_INPUT = 2
EXIT_STOPPED = 3
EXIT_NOT_PASSED = 4


class ExecutorError(ValueError):
    """An executor that cannot be started as asked: an unreachable scheduler, an impossible number of workers."""


class ExportError(ValueError):
    """An export that cannot be made as asked; nothing was written."""


class BenchError(ValueError):
    """A measurement that does not belong to its campaign, or a question that it cannot answer."""


class PlaceError(ValueError):
    """A path that no disk can have: its name is too long, or its links lead in a circle."""


class Stopped(RuntimeError):
    """The campaign stopped before its end; what is committed is whole, and `resume` continues from there."""


class StoreGoneError(Stopped):
    """The store was renamed or deleted while a run worked on it: there is nothing to resume at its path."""


@contextlib.contextmanager
def machine_faults() -> Iterator[None]:
    """Turn what the machine refuses (its disk, its memory) into Stopped: nobody's input is to blame."""
    try:
        yield
    except MemoryError as e:
        raise Stopped(f"the memory is not enough ({e or 'MemoryError'}); close other programs, or ask for less") from e
    except OSError as e:
        if e.errno == errno.EPIPE:  # whoever read our output is gone
            raise
        if e.errno in (errno.ENAMETOOLONG, errno.ELOOP):
            raise PlaceError(f"{e.strerror}: {str(e.filename)[:120]}…; give another path") from e
        raise Stopped(f"the machine refuses ({type(e).__name__}: {e})") from e
