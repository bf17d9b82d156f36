"""Claims about a series of campaigns: it says what a single run says."""

from __future__ import annotations

from pathlib import Path

import pytest

from reported import empty_store
from softclose_workflows.run import runtime
from softclose_workflows.run.executors.serial import SerialExecutor
from softclose_workflows.run.stopping import StopRequest
from softclose_workflows.studies import series


class Nothing:
    """A campaign that has nothing to do."""

    def __init__(self, *_: object, **__: object) -> None: ...

    def run(self) -> None: ...


@pytest.mark.parametrize("quiet", [True, False])
def test_a_series_tells_that_versions_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], quiet: bool
) -> None:
    store = empty_store(tmp_path)
    monkeypatch.setattr(series, "Driver", Nothing)
    series._run(store, SerialExecutor(), StopRequest(), series.Effort(quiet=quiet))
    assert "note:" not in capsys.readouterr().err
    others = {name: "0.0.1" if name == "zarr" else "9" for name in runtime.RECORDED_VERSIONS}
    monkeypatch.setattr(runtime, "_versions", lambda: others)
    series._run(store, SerialExecutor(), StopRequest(), series.Effort(quiet=quiet))
    said = capsys.readouterr().err
    assert "note: zarr is 0.0.1, the store was made with" in said
    assert "bits of further candidates may differ" in said
