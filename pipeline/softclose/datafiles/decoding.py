"""Owns how a file's bytes become lines: UTF-8 with and without a byte-order mark, UTF-16, UTF-32, Latin-1."""

from __future__ import annotations

import codecs
from dataclasses import dataclass
from pathlib import Path

from softclose.datafiles.errors import TableError
from softclose.tables import at_home

MOST_BYTES = 64 * 2**20
"""A larger file is refused before it is read: lines take some ten times as much memory."""

_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),  # before UTF-16, whose mark it begins with
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_BINARY = (
    (b"PK\x03\x04", "a spreadsheet or a ZIP archive; save it as CSV"),
    (b"\xd0\xcf\x11\xe0", "an old Excel file; save it as CSV"),
    (b"\x1f\x8b", "compressed by gzip; unpack it"),
    (b"\x89HDF", "an HDF5 file; export it as CSV"),
    (b"%PDF", "a PDF"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Decoded:
    """The lines of a file."""

    lines: tuple[str, ...]
    """Without their ends (\\n, \\r\\n or \\r)."""
    encoding: str
    """As Python calls it."""


def decoded(path: str | Path) -> Decoded:
    """Read a file. Raises TableError where it is none, too large, binary, or broken in its encoding."""
    file = at_home(path)
    try:
        if not file.is_file():  # a pipe or a device would never end
            raise TableError(f"{path} cannot be read: {'it is not a plain file' if file.exists() else 'no such file'}")
        if file.stat().st_size > MOST_BYTES:
            raise TableError(
                f"{path} has {file.stat().st_size / 2**20:,.0f} MiB; at most {MOST_BYTES // 2**20} MiB are read: "
                "keep the part that matters"
            )
        data = file.read_bytes()
    except (OSError, ValueError) as e:
        if isinstance(e, TableError):
            raise
        raise TableError(f"{path} cannot be read: {e}") from e
    for magic, what in _BINARY:
        if data.startswith(magic):
            raise TableError(f"{path} is {what}")
    text, encoding = _decode(data, str(path))
    if "\0" in text:
        raise TableError(f"{path} is not text: it has zero bytes")
    return Decoded(lines=tuple(text.replace("\r\n", "\n").replace("\r", "\n").split("\n")), encoding=encoding)


def _decode(data: bytes, path: str) -> tuple[str, str]:
    encoding = next((name for mark, name in _MARKS if data.startswith(mark)), None)
    if encoding is None and b"\0" in data[:4096]:  # UTF-16 without its mark: every second byte of plain text is zero
        even, odd = data[:4096:2].count(0), data[1:4096:2].count(0)
        encoding = "utf-16-le" if odd > 8 * even else "utf-16-be" if even > 8 * odd else None
        if encoding is None:
            raise TableError(f"{path} is not text: it has zero bytes")
    if encoding is not None:
        try:
            return data.decode(encoding).removeprefix("\ufeff"), encoding
        except UnicodeDecodeError as e:
            raise TableError(f"{path} begins like {encoding} but is not: {e.reason} at byte {e.start}") from e
    for encoding in ("utf-8", "cp1252"):
        try:
            return data.decode(encoding), encoding
        except UnicodeDecodeError:
            continue
    return data.decode("latin-1"), "latin-1"
