"""Claims about `softclose tails`: what it answers is what the library says of the stored waveform."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from small_campaigns import COARSE, make_campaign
from softclose import Waveform
from softclose.settings import CampaignConfig
from softclose.uncertainty.tails import tail
from softclose_store import open_campaign
from softclose_workflows.cli import main

pytest.importorskip("openturns")


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return make_campaign(tmp_path_factory.mktemp("tails") / "a.zarr", *COARSE)


def invoke(*words):
    return CliRunner().invoke(main, ["tails", *map(str, words)], env={"COLUMNS": "160"})


def test_every_question_is_answered_by_every_method_asked_for(store):
    words = ["--candidate", 3, "--limit", 15, "--open", "--method", "brute", "--method", "importance"]
    done = invoke(store, *words, "--switches", 2000, "--error", 0.2, "--json")
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)["tails"]
    assert [(r["event"], r["method"]) for r in rows] == [
        (event, method) for event in ("fast", "open") for method in ("brute", "importance")
    ]
    campaign = open_campaign(store)
    config = CampaignConfig.from_dict(campaign.config)
    waveform = Waveform.from_rows(campaign.waveform(3))
    (expected,) = tail(config, waveform, "fast", limit_cm_s=15.0, methods=["brute"], n_switches=2000)
    assert rows[0]["probability"] == expected.probability
    assert (rows[0]["interval"], rows[0]["limit_cm_s"]) == (list(expected.interval), 15.0)
    assert rows[2]["limit_cm_s"] is None


def test_the_table_names_failures_and_what_went_wrong(store):
    done = invoke(store, "--limit", 900, "--method", "brute", "--method", "form", "--switches", 100)
    assert done.exit_code == 0
    assert "V > 900 cm/s" in done.stdout
    assert "no failure was found" in done.stdout


def test_the_campaign_s_limits_are_asked_about_by_default(store):
    done = invoke(store, "--method", "brute", "--switches", 100, "--json")
    assert [r["limit_cm_s"] for r in json.loads(done.stdout)["tails"]] == [19.7]


def test_bad_questions_end_with_one_line(store):
    for words, said in ((["--limit", "-3"], "must be above 0"), (["--candidate", "99"], "99")):
        done = invoke(store, *words, "--method", "brute", "--switches", 100)
        assert done.exit_code == 2
        assert said in done.output
