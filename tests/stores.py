"""Owns the comparison of two whole stores, array by array and bit for bit, through zarr alone."""

from __future__ import annotations

import json
import os
import random
from pathlib import Path
from typing import Any

import numpy as np
import zarr


def arrays_of(path: Path) -> dict[str, Any]:
    """Every array below path at its full, unconsolidated shape, by its name."""
    root = zarr.open_group(str(path), mode="r", use_consolidated=False)
    return {name: node for name, node in root.members(max_depth=None) if isinstance(node, zarr.Array)}


def contents_of(path: Path) -> dict[str, dict[str, bytes]]:
    """Every array below path by its name: its files by theirs."""
    found: dict[str, dict[str, bytes]] = {}
    for folder, _, files in os.walk(path):
        of = Path(folder)
        if "zarr.json" in files and json.loads((of / "zarr.json").read_bytes()).get("node_type") == "array":
            found[of.relative_to(path).as_posix()] = {
                file.relative_to(of).as_posix(): file.read_bytes() for file in of.rglob("*") if file.is_file()
            }
    return found


def differences(a: Path, b: Path) -> list[str]:
    """Names of arrays that differ in shape, type or any bit. Timings (`wall_*`) are left out, as the contract says.

    Of arrays whose files are the same zarr reads the same: the others are read.
    """
    left, right = contents_of(a), contents_of(b)
    found = [f"{name} is in one store only" for name in sorted(left.keys() ^ right.keys())]
    for name in sorted(left.keys() & right.keys()):
        if name.rpartition("/")[2].startswith("wall_") or left[name] == right[name]:
            continue
        x, y = (np.asarray(zarr.open_array(str(path / name), mode="r")[...]) for path in (a, b))
        if x.dtype.kind == "T":  # bytes of long text are places in memory, not characters
            same = x.shape == y.shape and x.tolist() == y.tolist()
        else:
            same = x.dtype == y.dtype and x.shape == y.shape and x.tobytes() == y.tobytes()
        if not same:
            found.append(name)
    return found


def visible_lengths(path: Path) -> set[int]:
    """Lengths of the `candidate` dimension that a reader of the consolidated metadata sees in the tables."""
    root = zarr.open_group(str(path), mode="r")["candidates"]
    return {
        array.shape[0]
        for _, array in root.arrays()
        if array.metadata.dimension_names and array.metadata.dimension_names[0] == "candidate"
    }


def files_of(path: Path) -> list[Path]:
    """Every file below path, sorted."""
    return sorted(p for p in path.rglob("*") if p.is_file())


def damage(file: Path, kind: str, rng: random.Random) -> None:
    """Damage a file: flip one bit, truncate it, append to it, or delete it."""
    content = file.read_bytes()
    if kind == "flip":
        at = rng.randrange(len(content))
        file.write_bytes(content[:at] + bytes([content[at] ^ (1 << rng.randrange(8))]) + content[at + 1 :])
    elif kind == "truncate":
        file.write_bytes(content[: rng.randrange(len(content))])
    elif kind == "append":
        file.write_bytes(content + rng.randbytes(1 + rng.randrange(8)))
    else:
        file.unlink()
