"""Claims about a test session's last words: what it did not run, and why."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from not_run import lines

TESTS = """
import pytest

@pytest.mark.parametrize("n", [1, 2])
@pytest.mark.long
def test_whole(n): pass

def test_short(): pass

@pytest.mark.parametrize("n", [1, 2, 3])
def test_with(n): pytest.skip("sbatch is not installed")
"""


@pytest.mark.parametrize("processes", ["0", pytest.param("2", marks=pytest.mark.long)])
def test_a_session_ends_with_what_it_did_not_run(processes: str, tmp_path: Path) -> None:
    """In one process, and in several, which each leave out the same."""
    here = Path(__file__).parent
    (tmp_path / "pytest.ini").write_text("[pytest]\naddopts = -m 'not long'\nmarkers = long\n")
    hooks = (here / "not_run.py").read_text("utf-8")
    (tmp_path / "conftest.py").write_text(hooks, "utf-8")
    (tmp_path / "test_some.py").write_text(TESTS)
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "xdist", "-n", processes]
    done = subprocess.run([*words, str(tmp_path)], cwd=tmp_path, capture_output=True, text=True, check=True)
    _, said = done.stdout.split(" not run ===")
    assert [line.partition(":")[0] for line in said.splitlines()[1:4]] == [
        "3 × sbatch is not installed (apt-get install slurm-wlm)",
        "2 × long, of 1 claims with a short case here",
        "everything on any other Python, system and processor",
    ]


def test_the_most_frequent_reason_comes_first_and_an_unknown_one_stands_alone() -> None:
    assert lines(["b", "a", "a"], [])[:2] == ["2 × a", "1 × b"]
    assert len(lines([], [])) == 1
