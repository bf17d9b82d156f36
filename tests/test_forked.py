"""Claims about processes that begin with their imports done: they are processes of their own all the same."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path

import pytest

from forked import Forked

SAYS = """
import os, sys, threading
print(sys.argv[1:], os.getcwd(), os.environ.get("WORD"), os.getpid(), threading.active_count())
print("aside", file=sys.stderr)
sys.exit(7)
"""


def test_it_has_arguments_environment_folder_streams_and_an_end_of_its_own(tmp_path: Path) -> None:
    asked = {"env": os.environ | {"WORD": "a b"}, "folder": tmp_path, "program": SAYS}
    process = Forked("one", "two", stdout=subprocess.PIPE, stderr=subprocess.PIPE, **asked)
    stdout, stderr = process.communicate(timeout=60)
    assert process.returncode == 7
    assert stdout == f"['one', 'two'] {tmp_path} a b {process.pid} 1\n"
    assert stderr == "aside\n"
    assert process.pid != os.getpid()


def test_it_finds_modules_where_its_environment_says(tmp_path: Path) -> None:
    (tmp_path / "of_my_own.py").write_text("print('found')")
    asked = {"env": os.environ | {"PYTHONPATH": str(tmp_path)}, "program": "import of_my_own"}
    process = Forked(stdout=subprocess.PIPE, stderr=subprocess.PIPE, **asked)
    assert process.communicate(timeout=60) == ("found\n", "")


def test_it_is_killed_and_waited_for() -> None:
    process = Forked(program="import time; time.sleep(60)")
    assert process.poll() is None
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.01)
    process.kill()
    assert process.wait(60) == process.poll() == -signal.SIGKILL
    with pytest.raises(ProcessLookupError):
        os.kill(process.pid, 0)


def test_what_nobody_catches_is_told_as_by_any_interpreter() -> None:
    process = Forked(stderr=subprocess.PIPE, program="raise OSError('a disk')")
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 1
    assert stderr.startswith("Traceback")
    assert stderr.endswith("OSError: a disk\n")


def test_it_is_the_program() -> None:
    process = Forked("status", "/nowhere/a.zarr", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    stdout, stderr = process.communicate(timeout=60)
    assert (process.returncode, stdout) == (2, "")
    assert stderr.startswith("softclose: there is no campaign at /nowhere/a.zarr")
