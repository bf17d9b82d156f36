"""Claims about the cache of machine code: none can be written, and the kernels run, and it is said."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numba
import pytest
from numba.core import caching

from softclose import compiled


@pytest.fixture(autouse=True)
def nowhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A machine where numba may write neither beside the source nor at home."""
    monkeypatch.setattr(
        caching.CacheImpl, "_locator_classes", caching.CacheImpl._locator_classes[:1]
    )  # NUMBA_CACHE_DIR
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(compiled, "_said", set())
    return tmp_path


def twice(x: float) -> float:
    return 2.0 * x


def test_numba_alone_refuses() -> None:
    with pytest.raises(RuntimeError, match="cannot cache function"):
        numba.njit(cache=True)(twice)


def test_code_is_kept_in_a_folder_of_one_s_own_and_it_is_said(nowhere: Path) -> None:
    with pytest.warns(UserWarning, match=r"kernels are kept in .*softclose-kernels"):
        function = compiled.cached_njit(nogil=True)(twice)
    assert function(3.0) == 6.0
    folder = nowhere / f"softclose-kernels-{os.getuid()}"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert list(folder.rglob("*.nbc"))
    compiled.cached_njit(nogil=True)(twice)  # it is said once


@pytest.mark.parametrize("how", ["open to others", "a link", "a file", "read-only"])
def test_code_is_not_taken_from_what_others_may_write(how: str, nowhere: Path) -> None:
    """What lies in a cache is executed: somebody else may have put the folder there before."""
    folder = nowhere / f"softclose-kernels-{os.getuid()}"
    if how == "open to others":
        folder.mkdir()
        folder.chmod(0o777)
    elif how == "a link":
        (nowhere / "theirs").mkdir(mode=0o700)
        folder.symlink_to(nowhere / "theirs")
    elif how == "a file":
        folder.write_text("")
    elif os.getuid() == 0:
        pytest.skip("root writes everywhere")
    else:
        folder.mkdir(mode=0o500)
    with pytest.warns(UserWarning, match="compiled anew by every process"):
        function = compiled.cached_njit()(twice)
    assert function(3.0) == 6.0
    assert not list(nowhere.rglob("*.nbc"))


def test_other_refusals_of_numba_are_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**options: object) -> None:
        raise RuntimeError("no LLVM")

    monkeypatch.setattr(compiled, "njit", refuse)
    with pytest.raises(RuntimeError, match="no LLVM"):
        compiled.cached_njit()(twice)
