"""Claims about certification by a race: what is kept is the certificate of that size, and of who was left."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from small_campaigns import COARSE, make_campaign
from softclose_workflows.analyses.certify import CertifyError, certify, read_certification
from softclose_workflows.analyses.finalists import certify_within
from softclose_workflows.cli import main


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    return make_campaign(tmp_path_factory.mktemp("finalists") / "a.zarr", *COARSE)


def test_finalists_are_certified_as_a_certification_of_that_size_does(
    store: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("softclose_workflows.analyses.finalists.LEAST", 80)
    result, race = certify_within(store, 0.3, n_switches=12_000, top=6)
    last = race.laps[-1]
    assert race.decided
    assert result.n_switches == last.n_switches
    assert result.best.candidate == last.best
    assert {*race.finalists} <= {d.candidate for d in result.candidates} <= {*race.finalists, result.incumbent}
    read = read_certification(store)
    assert read is not None
    assert [d.name for d in read.candidates] == [d.name for d in result.candidates]
    other = certify(make_campaign(tmp_path / "b.zarr", *COARSE), n_switches=last.n_switches, top=6)
    for a in (*result.candidates, *result.references):
        b = next(d for d in (*other.candidates, *other.references) if d.name == a.name)
        np.testing.assert_array_equal(a.response.max_contact_speed, b.response.max_contact_speed)
        assert repr(a.assessment) == repr(b.assessment)
    assert other.best.candidate == result.best.candidate
    assert race.trajectories < last.n_switches * len(race.laps[0].racing)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, math.nan, math.inf, True])
def test_a_tolerance_that_is_none_is_refused(store: str, tolerance: float) -> None:
    with pytest.raises(CertifyError, match="--within"):
        certify_within(store, tolerance)


def test_the_command_says_what_the_race_found(store: str) -> None:
    arguments = ["certify", store, "--within", "0.3", "--switches", "12000", "--top", "6", "-q"]
    told = CliRunner().invoke(main, arguments)
    assert told.exit_code == 0, told.output
    assert "decided: candidate" in told.output
    plain = CliRunner().invoke(main, [*arguments, "--json"])
    race = json.loads(plain.output)["race"]
    assert race["decided"] is True
    assert f"decided: candidate {race['laps'][-1]['best']} is the best of 6" in told.output
    short = CliRunner().invoke(main, ["certify", store, "--within", "1e-6", "--switches", "1500", "--top", "6", "-q"])
    assert "not decided to 1e-06 cm/s" in short.output or "within 0.000" in short.output
