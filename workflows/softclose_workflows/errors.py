"""Owns the outcomes that end a command early, and their exit codes.

0: done; 2: bad input, nothing was changed; 3: stopped before the end, nothing committed is lost, `resume` continues.
"""

from __future__ import annotations

EXIT_BAD_INPUT = 2
EXIT_STOPPED = 3


class ExecutorError(ValueError):
    """An executor that cannot be started as asked: an unreachable scheduler, an impossible number of workers."""


class ExportError(ValueError):
    """An export that cannot be made as asked; nothing was written."""


class Stopped(RuntimeError):
    """The campaign stopped before its end; what is committed is whole, and `resume` continues from there."""
