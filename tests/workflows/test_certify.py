"""Claims about certification: what is ranked, on which switches, and that it is kept as it was."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from small_campaigns import COARSE, make_campaign
from softclose import Pulse, Waveform, simulate
from softclose.conditions.streams import Ensemble
from softclose.evaluate import respond
from softclose.settings import CampaignConfig, load_config
from softclose_store import DamageError, group_attributes, list_groups, open_campaign, read_group
from softclose_workflows.analyses.certificates import read_certificate, write_certificate
from softclose_workflows.analyses.certification import Certified
from softclose_workflows.analyses.certify import (
    DISTINCT_VOLTS,
    CertifyError,
    assess_fresh,
    certify,
    certify_again,
    choose_distinct,
    drawn_fresh,
    fresh_switches,
    read_certification,
    reference_designs,
    simulate_fresh,
)
from softclose_workflows.analyses.chosen import choose
from softclose_workflows.analyses.drive_off import GAINS, drive_off_lines, drive_off_to_json
from softclose_workflows.analyses.hold import holds_of
from softclose_workflows.cli import main

N = 1500


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    return make_campaign(tmp_path_factory.mktemp("certify") / "a.zarr", *COARSE)


def test_candidates_are_ranked_by_what_they_do_on_fresh_switches(store: str) -> None:
    result = certify(store, n_switches=N, top=4)
    g = [d.assessment.g_cm_s for d in result.candidates]
    assert g == sorted(g)
    assert len(g) == 4
    assert result.incumbent in [d.candidate for d in result.candidates]
    assert [d.name for d in result.references] == ["unshaped", "deterministic"]
    assert result.references[0].assessment.v_u_cm_s == pytest.approx(41.6, abs=1.2)  # SPEC §7
    for d in result.candidates:
        assert d.optimism_cm_s == d.assessment.g_cm_s - open_campaign(store).records()["g_cm_s"][d.candidate]


def test_each_switch_is_the_simulation_of_a_fresh_switch(store: str) -> None:
    result = certify(store, n_switches=N, top=4)
    again = simulate(fresh_switches(load_config("current"), N, seed=result.seed), result.best.waveform)
    np.testing.assert_array_equal(result.best.response.max_contact_speed, again.max_contact_speed)
    np.testing.assert_array_equal(result.best.response.closed, again.closed)


def test_no_seed_makes_the_fresh_switches_the_training_switches() -> None:
    config = load_config("current")
    training = {tuple(row) for row in config.build_population().sample(500, seed=1)}
    assert Ensemble.CERTIFICATE != Ensemble.TRAINING
    for seed in range(5):
        assert not training & {tuple(row) for row in fresh_switches(config, 500, seed=seed).switches}


def test_certified_candidates_are_distinct_waveforms(store: str) -> None:
    t = np.linspace(0.0, 250.0, 1001)
    u = [d.waveform.voltage(t) for d in certify(store, n_switches=N, top=4).candidates]
    for i, a in enumerate(u):
        for b in u[:i]:
            assert math.sqrt(np.mean((a - b) ** 2)) >= DISTINCT_VOLTS


def test_certification_is_read_back_as_it_was_and_not_computed_again(
    store: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = certify(store, n_switches=N, top=4)
    monkeypatch.setattr("softclose_workflows.analyses.certify.simulate_fresh", None)
    again = certify(store, n_switches=N, top=4)
    read = read_certification(store)
    assert read is not None
    for other in (again, read):
        assert [d.name for d in other.candidates] == [d.name for d in first.candidates]
        for a, b in zip(first.candidates + first.references, other.candidates + other.references, strict=True):
            assert repr(a.assessment) == repr(b.assessment)
            np.testing.assert_array_equal(a.response.max_contact_speed, b.response.max_contact_speed)
            assert a.waveform == b.waveform


def odd_pieces(function, pieces):  # type: ignore[no-untyped-def]
    """Answers the last piece first."""
    return iter([function(piece) for piece in reversed(list(pieces))][::-1])


def test_stored_content_depends_on_nothing_but_the_request(store: str, tmp_path: Path) -> None:
    other = make_campaign(tmp_path / "other.zarr", *COARSE)
    certify(store, n_switches=N, seed=5, top=2)
    certify(other, n_switches=N, seed=5, top=1)
    certify(other, n_switches=N, seed=5, top=2, mapper=odd_pieces)
    first, second = (read_group(path, f"certification/{N}-5") for path in (store, other))
    assert first.attributes == second.attributes
    assert first.arrays.keys() == second.arrays.keys()
    for name, values in first.arrays.items():
        np.testing.assert_array_equal(values, second.arrays[name])


def test_a_small_certification_does_not_replace_a_large_one(tmp_path: Path) -> None:
    store = make_campaign(tmp_path / "a.zarr", *COARSE)
    large = certify(store, n_switches=2 * N, top=3)
    small = certify(store, n_switches=100, top=3)
    assert list_groups(store) == [f"certification/{n}-1" for n in sorted((100, 2 * N), key=str)]
    counts = read_certification(store)
    assert counts is not None
    assert counts.n_switches == 2 * N
    assert choose(store).candidate == large.best.candidate
    assert small.n_switches == 100
    same_size = certify(store, n_switches=2 * N, seed=99, top=1)
    assert same_size.seed == 99
    assert choose(store).seed == 1  # as many switches, as much of the campaign: the smallest seed


def test_fewer_candidates_do_not_take_certified_ones_away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = make_campaign(tmp_path / "a.zarr", *COARSE)
    few = certify(store, n_switches=N, top=2)
    many = certify(store, n_switches=N, top=4)
    assert {d.candidate for d in many.candidates} > {d.candidate for d in few.candidates}
    monkeypatch.setattr("softclose_workflows.analyses.certify.simulate_fresh", None)
    again = certify(store, n_switches=N, top=1)
    assert [d.candidate for d in again.candidates] == [d.candidate for d in many.candidates]


def test_a_certification_is_computed_again_from_its_metadata(tmp_path: Path) -> None:
    store = make_campaign(tmp_path / "a.zarr", *COARSE)
    certify(store, n_switches=N, top=3)
    name = f"certification/{N}-1"
    before = {p: p.read_bytes() for p in (tmp_path / "a.zarr" / name).rglob("*") if p.is_file()}
    damaged = next(p for p in before if "max_contact_speed" in str(p) and p.name != "zarr.json")
    damaged.write_bytes(b"nothing")
    with pytest.raises(DamageError):
        read_certification(store)
    certify_again(store, name, group_attributes(store, name))
    assert {p: p.read_bytes() for p in before} == before
    with pytest.raises(CertifyError, match="does not say any more what was certified"):
        certify_again(store, name, None)


def test_a_missing_reference_says_why(tmp_path: Path) -> None:
    store = make_campaign(tmp_path / "a.zarr", *COARSE, "waveform.max_volts=60")
    result = certify(store, n_switches=100, top=1)
    assert [d.name for d in result.references] == ["unshaped"]
    assert result.references[0].waveform.max_voltage(250.0) == 60.0
    assert "60 V never bring the mean switch" in result.missing["deterministic"]
    read = read_certification(store)
    assert read is not None
    assert read.missing == result.missing
    told = CliRunner().invoke(main, ["certify", store, "--switches", "100", "--top", "1"]).stdout
    assert "no deterministic design to compare with: 60 V never bring" in told
    said = json.loads(CliRunner().invoke(main, ["certify", store, "--switches", "100", "--top", "1", "--json"]).stdout)
    assert said["missing_references"] == result.missing


def test_pieces_of_the_fresh_switches_make_the_same_ensemble(store: str, monkeypatch: pytest.MonkeyPatch) -> None:
    config = CampaignConfig.from_dict(open_campaign(store).config)
    waveforms = [Waveform([Pulse(0, 0, math.inf, u)]) for u in (100.0, 60.0)]
    (whole, other) = simulate_fresh(config, waveforms, n_switches=50, seed=3)
    monkeypatch.setattr("softclose.evaluate.pieces.rows_a_piece", lambda *_, **__: 20)
    steps: list[tuple[int, int]] = []
    (pieces, _) = simulate_fresh(config, waveforms, n_switches=50, seed=3, listener=lambda *s: steps.append(s))
    np.testing.assert_array_equal(pieces.max_contact_speed, whole.max_contact_speed)
    assert pieces.status.dtype == np.int8
    assert np.nanmean(other.max_contact_speed) < np.nanmean(whole.max_contact_speed)
    assert steps == [(40, 100), (80, 100), (100, 100)]


def test_a_certificate_that_memory_does_not_hold_is_the_same_to_the_byte(
    store: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Responses in a file, the lot and its hold margins drawn by whoever simulates."""
    config = CampaignConfig.from_dict(open_campaign(store).config)

    def certified(name: str) -> tuple[Any, Any, dict[str, bytes]]:
        path = shutil.copytree(store, tmp_path / name)
        result = certify(str(path), n_switches=2_100, top=3)
        group = path / "certification" / "2100-1"
        files = {str(p.relative_to(group)): p.read_bytes() for p in group.rglob("*") if p.is_file()}
        return result, holds_of(config, result), files

    plain, holds, files = certified("plain.zarr")
    asked: list[int] = []

    def elsewhere(function: Any, pieces: Any, /) -> Any:
        pieces = list(pieces)
        asked.append(len(pieces))
        return map(function, pieces)

    monkeypatch.setattr("softclose.evaluate.gathered.MOST_BYTES", 0)
    monkeypatch.setattr("softclose.evaluate.pieces.rows_a_piece", lambda *_, **__: 400)
    for module in ("certify", "hold"):
        monkeypatch.setattr(f"softclose_workflows.analyses.{module}.MANY", 2_000)
    large, same, others = certified("large.zarr")
    assert files
    assert others == files
    assert same == holds
    assert [d.assessment for d in large.candidates] == [d.assessment for d in plain.candidates]
    assert not large.best.response.closed.flags.owndata
    assert holds_of(config, large, mapper=elsewhere) == holds
    assert drawn_fresh(config, 2_001, seed=1, mapper=elsewhere)["K"].shape == (2_001,)
    assert asked == [6, 6]
    drawn_fresh(config, 2_000, seed=1, mapper=elsewhere)
    assert asked == [6, 6], "few are drawn here"


def test_the_best_distinct_waveforms_are_those_of_promise_and_the_incumbent() -> None:
    volts = {0: 80.0, 1: 80.1, 2: 60.0, 3: 90.0, 4: 70.0, 5: 100.0}
    g = np.array([14.0, 13.0, 16.0, 15.0, 12.0, 10.0])
    se = np.array([0.1, math.nan, 9.0, 0.1, 2.5, 0.1])  # candidate 4 promises 14.5 at most
    failed = np.array([False, False, False, False, False, True])
    campaign: Any = SimpleNamespace(
        path="a.zarr",
        best=lambda: SimpleNamespace(candidate=2),
        records=lambda: {"failed": failed, "rank_cm_s": g, "g_se_cm_s": se},
        waveform=lambda i: Waveform([Pulse(0, 0, math.inf, volts[i])]).rows(),
    )
    config = load_config("current")
    # Candidate 0 is candidate 1 but for a tenth of a volt.
    assert choose_distinct(campaign, config, 10) == (2, [2, 1, 4, 3])
    assert choose_distinct(campaign, config, 3) == (2, [2, 1, 4])


def test_a_certification_remembers_how_much_of_the_campaign_it_saw(store: str) -> None:
    result = certify(store, n_switches=100, seed=9, top=2)
    table = open_campaign(store).records()
    for d in result.candidates:
        assert d.training is not None
        assert d.training.v_u_cm_s == table["v_u_cm_s"][d.candidate]
        assert d.training.p_nc == table["p_nc"][d.candidate]
        assert d.training.n_switches == 80
    group = read_group(store, "certification/100-9")
    n = len(result.candidates)
    assert group.arrays["candidate"].tolist() == [d.candidate for d in result.candidates] + [-1, -1]
    assert group.arrays["training_n_switches"].tolist() == [80] * n + [0, 0]
    assert np.isnan(group.arrays["training_g_cm_s"]).tolist() == [False] * n + [True, True]


def test_intervals_hold_on_fresh_switches_whatever_the_campaign_samples(store: str) -> None:
    config = load_config("current", ["population.sampling=sobol"])
    (response,) = simulate_fresh(config, [Waveform([Pulse(0, 0, math.inf, 100)])], n_switches=20, seed=1)
    assert assess_fresh(response, config).intervals_valid


def test_the_deterministic_design_rises_as_fast_as_the_campaign_s_waveforms_may() -> None:
    for rise_us in (2.5, 4.0, 6.0):
        found = reference_designs(load_config("current", [f"waveform.min_rise_us={rise_us}"]))
        assert [p.rise_us for p in found.designs["deterministic"].pulses] == [rise_us, rise_us]


def test_reference_designs_keep_the_campaign_s_limit() -> None:
    designs = reference_designs(load_config("current", ["waveform.max_volts=120"])).designs
    assert designs["deterministic"].max_voltage() <= 120.0 * (1.0 + 1e-9)


def test_the_campaign_is_left_as_it_was(store: str) -> None:
    before = open_campaign(store)
    certify(store, n_switches=100, seed=8, top=1)
    after = open_campaign(store)
    assert after.committed == before.committed
    assert after.fingerprint == before.fingerprint


def test_command_prints_one_json_object(store: str) -> None:
    done = CliRunner().invoke(main, ["certify", store, "--switches", str(N), "--top", "2", "--json"])
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    best = said["candidates"][0]
    assert best["p_nc_intervals"].keys() >= {"wald", "wilson", "clopper_pearson"}
    assert best["p_exceed"][0]["limit_cm_s"] == 19.7
    assert best["v_u_interval"][0] <= best["v_u_cm_s"] <= best["v_u_interval"][1]
    assert said["best_against"].keys() == {"unshaped", "deterministic"}
    assert best["waveform"][-1][2] is None
    plain = CliRunner().invoke(main, ["certify", store, "--switches", str(N), "--top", "2"])
    assert "against unshaped" in plain.stdout


def test_bad_requests_are_refused(store: str, tmp_path: Path) -> None:
    with pytest.raises(CertifyError, match=r"79 new switches certify nothing here: at least 80 are needed"):
        certify(store, n_switches=79)
    one = CliRunner().invoke(main, ["certify", store, "--switches", "1"])
    assert one.exit_code == 2
    assert "at least 80 are needed" in one.stderr
    with pytest.raises(CertifyError, match="0 candidates are to be certified"):
        certify(store, n_switches=N, top=0)
    nothing = CliRunner().invoke(main, ["certify", str(tmp_path / "none.zarr")])
    assert nothing.exit_code == 2
    assert "none.zarr" in nothing.stderr


@pytest.mark.parametrize("store_trajectories", [False, True])
def test_room_is_asked_for_as_many_designs_as_are_certified(
    store: str, tmp_path: Path, store_trajectories: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is simulated: a certificate of 10 designs with trajectories may be larger than the disk."""
    asked: list[Any] = []
    monkeypatch.setattr("softclose_workflows.run.needs.check_fresh", lambda *a, **k: asked.append((*a, k)))
    copy = str(shutil.copytree(store, tmp_path / "room.zarr"))
    result = certify(copy, n_switches=101, top=1, store_trajectories=store_trajectories)
    ((n_switches, n_designs, about),) = asked
    assert (n_switches, n_designs) == (101, len(result.candidates) + len(result.references))
    assert about["path"] == copy
    assert (about["kept"] is not None) == store_trajectories


def test_what_takes_long_is_done_by_whoever_simulates(
    store: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The candidates, what a drive that is a little off does, and drawing many switches."""
    asked: list[str] = []
    monkeypatch.setattr("softclose_workflows.analyses.certify.MANY", 101)
    monkeypatch.setattr("softclose_workflows.analyses.drive_off.QUICK_S", 0.0)

    def mapper(function, pieces):  # type: ignore[no-untyped-def]
        asked.append(function.__name__)
        return map(function, pieces)

    for n, drawn in ((101, []), (102, ["_drawn_fresh"])):
        copy = str(shutil.copytree(store, tmp_path / f"{n}.zarr"))
        certify(copy, n_switches=n, top=1, mapper=mapper)
        assert asked == ["_simulate_fresh", "judged_rows", *drawn]
        asked.clear()


def test_a_campaign_without_candidates_cannot_be_certified(tmp_path: Path) -> None:
    store = make_campaign(tmp_path / "empty.zarr", *COARSE, run=False)
    with pytest.raises(CertifyError, match="no usable candidate yet"):
        certify(store, n_switches=N)


def test_a_certificate_says_what_a_drive_that_is_a_little_off_does(
    store: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = certify(store, n_switches=400, top=1)
    rows = result.drive_off
    assert [row.gain for row in rows] == list(GAINS)
    assert rows[2].assessment == result.best.assessment
    config = CampaignConfig.from_dict(open_campaign(store).config)
    for row in rows:
        volts = [replace(p, volts=p.volts * (1.0 + row.gain)) for p in result.best.waveform.pulses]
        (alone,) = simulate_fresh(config, [Waveform(volts)], n_switches=400, seed=result.seed)
        assert row.assessment.v_u_cm_s == pytest.approx(assess_fresh(alone, config).v_u_cm_s, abs=0.02)
    told = drive_off_to_json(rows)
    assert [row["gain"] for row in told] == list(GAINS)
    assert told[2]["p_nc"] == result.best.assessment.p_nc
    arrays = read_group(store, "certification/400-1").arrays
    assert arrays["drive_gain"].tolist() == list(GAINS)
    assert arrays["off_v_u_cm_s"].tolist() == [row.assessment.v_u_cm_s for row in rows]
    np.testing.assert_array_equal(arrays["off_max_contact_speed"][4], rows[4].response.max_contact_speed)
    stored = read_certificate(store, "certification/400-1")
    assert [row.assessment for row in stored.drive_off] == [row.assessment for row in rows]
    lines = CliRunner().invoke(main, ["certify", store, "--switches", "400", "--top", "1", "-q"]).stdout
    assert "the best where its volts are off, on all 400 new switches:" in lines
    assert "Volts +1 % is also what happens if the device model’s pull-in voltages are 1 % too high" in lines
    assert "volts +3 %: v_u " in lines
    monkeypatch.setattr(
        "softclose_workflows.analyses.certify.MOST", 150
    )  # the first switches only, where there are many
    other = str(shutil.copytree(store, tmp_path / "few.zarr"))
    few = certify(other, n_switches=401, top=1).drive_off
    assert {row.response.closed.size for row in few} == {150}
    told = drive_off_lines(few, 401)
    assert told[0] == "the best where its volts are off, on the first 150 of the 401 new switches:"
    assert any(line.startswith("  Compare these rows with each other: on all 401 switches") for line in told)
    np.testing.assert_array_equal(few[4].response.closed, rows[4].response.closed[:150])


def test_a_certificate_says_when_the_switches_first_touch_and_how_often(store: str) -> None:
    """By hand: the switches of the certificate again, their quantile by sorting."""
    best = certify(store, n_switches=400, top=1).best
    config = CampaignConfig.from_dict(open_campaign(store).config)
    found = respond(config, fresh_switches(config, 400, seed=1), best.waveform)
    touched = found.n_impacts > 0
    for name, values in (("contact_time", found.first_contact_us), ("impacts", found.n_impacts)):
        ordered = np.sort(values[touched])
        assert best.contacts[name].estimate == ordered[math.ceil(0.9 * ordered.size) - 1]
        low, high = best.contacts[name].interval
        assert low <= best.contacts[name].estimate <= high
    arrays = read_group(store, "certification/400-1").arrays
    np.testing.assert_array_equal(arrays["first_contact"][0], found.first_contact_us)
    np.testing.assert_array_equal(arrays["n_impacts"][0], found.n_impacts)
    assert arrays["contact_time"][0] == best.contacts["contact_time"].estimate
    run = CliRunner().invoke(main, ["certify", store, "--switches", "400", "--top", "1", "-q"])
    assert f"touch {best.contacts['contact_time'].estimate:.1f} (" in run.stdout
    told = json.loads(CliRunner().invoke(main, ["certify", store, "--switches", "400", "--top", "1", "--json"]).stdout)
    assert told["candidates"][0]["contacts"]["impacts"]["estimate"] == best.contacts["impacts"].estimate
    assert [row["gain"] for row in told["drive_off"]] == list(GAINS)


def test_a_certificate_of_an_older_version_is_read_and_made_whole(store: str, tmp_path: Path) -> None:
    path = str(shutil.copytree(store, tmp_path / "older.zarr"))
    whole = certify(path, n_switches=402, top=1)
    name = "certification/402-1"
    before = read_group(path, name)

    def without(d: Certified) -> Certified:
        return replace(d, contacts={}, response=replace(d.response, first_contact_us=None, n_impacts=None))

    older = replace(
        whole,
        candidates=tuple(map(without, whole.candidates)),
        references=tuple(map(without, whole.references)),
        drive_off=(),
    )
    config = CampaignConfig.from_dict(open_campaign(path).config)
    write_certificate(path, older, fresh_switches(config, 402, seed=1))
    read = read_certificate(path, name)
    assert not read.is_whole
    assert (read.drive_off, read.best.contacts, read.best.assessment) == ((), {}, whole.best.assessment)
    assert certify(path, n_switches=402, top=1).is_whole
    after = read_group(path, name)
    assert after.attributes == before.attributes
    for key, values in before.arrays.items():
        np.testing.assert_array_equal(after.arrays[key], values, err_msg=key)
