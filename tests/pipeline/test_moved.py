"""Claims about the addresses of version 0.1: what documents named still imports, as the very objects that moved."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

from softclose.moved import MOVED


@pytest.mark.parametrize(("old", "new"), MOVED.items())
def test_an_old_address_is_the_module_that_moved(old: str, new: str) -> None:
    moved = importlib.import_module(old)
    assert moved is importlib.import_module(new)
    assert moved.__name__ == new
    assert moved.__spec__ is not None
    assert moved.__spec__.name == new


def test_an_old_address_works_in_a_fresh_process_and_others_stay_unknown() -> None:
    program = (
        "from softclose.intervals import proportion\n"
        "import softclose.metrics.intervals as now\n"
        "assert proportion is now.proportion\n"
        "try:\n    import softclose.interval\nexcept ModuleNotFoundError:\n    print('refused')\n"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert run.stdout == "refused\n"
