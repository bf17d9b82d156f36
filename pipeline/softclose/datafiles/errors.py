"""Owns why a table cannot be read: for the user, and for the search among ways of reading."""

from __future__ import annotations


class TableError(ValueError):
    """A file that is no table of the kind that is asked for, or can be read in two ways; names file and line."""


class Unfit(Exception):
    """One way of reading does not fit the file: why, at which line, and how much of the file it did fit."""

    def __init__(self, why: str, *, line: int | None = None, fitted: float = 0.0) -> None:
        super().__init__(why)
        self.why = why
        self.line = line
        self.fitted = fitted
        """Of the ways that fail, the user hears of the one that fitted most."""

    def said(self, path: str) -> str:
        """`scope.csv, line 3: …`."""
        return f"{path}, line {self.line}: {self.why}" if self.line is not None else f"{path}: {self.why}"
