"""System programs that tests need, and pip does not bring."""

from __future__ import annotations

import shutil

import pytest


def require(program: str) -> str:
    """The path of a system program; without it the test is skipped by name."""
    found = shutil.which(program)
    if found is None:
        pytest.skip(f"{program} is not installed")
    return found
