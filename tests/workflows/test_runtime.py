"""Claims about the record of who ran a campaign, and on what."""

from __future__ import annotations

from softclose_workflows.run.runtime import changes_since, runtime


def test_nothing_differs_from_this_very_machine() -> None:
    assert changes_since(runtime()) == []


def test_another_processor_and_another_library_are_named() -> None:
    then = runtime()
    then["versions"]["numpy"] = "1.0.0"
    then["processor"] = "abacus"
    numpy, processor = changes_since(then)
    assert "the store was made with 1.0.0" in numpy
    assert "the store was made on abacus" in processor


def test_a_store_without_a_record_claims_nothing() -> None:
    assert changes_since({}) == []
