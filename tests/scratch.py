"""Says where the tests put their files: in memory where there is room, else where temporary files go.

Every commit of a store waits for the disk several times, and the tests commit tens of thousands of times. What a disk
does to a store that loses its power is what `power_loss.py` and `lose_power.py` play through, whatever lies below.

    TMPDIR=$(python tests/scratch.py) python -m pytest
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

MEMORY = Path("/dev/shm")
NEEDED_BYTES = 4_000_000_000
"""Stores of all tests that run at a time, several times over; a container often gives that folder 64 MB."""


def scratch(memory: Path = MEMORY, needed: int = NEEDED_BYTES) -> Path:
    """A folder for temporary files: `memory` where it can be written to and has the room."""
    if memory.is_dir() and os.access(memory, os.W_OK | os.X_OK) and shutil.disk_usage(memory).free >= needed:
        return memory
    return Path(tempfile.gettempdir())


if __name__ == "__main__":
    print(scratch())
