"""Claims about where the tests write."""

from __future__ import annotations

import tempfile
from pathlib import Path

from scratch import scratch


def test_memory_is_used_where_it_is_there_and_has_the_room(tmp_path: Path) -> None:
    usual = Path(tempfile.gettempdir())
    assert scratch(tmp_path, needed=1) == tmp_path
    assert scratch(tmp_path, needed=2**60) == usual
    assert scratch(tmp_path / "none", needed=1) == usual
