"""Claims about the first screen of the report: both references, what is assumed, health, the picture of the drive."""

from __future__ import annotations

import dataclasses
import math
import re
import shutil

import numpy as np
import pytest

from reported import hostile_store
from softclose import load_config
from softclose.metrics.objective import assess
from softclose.waveform import Pulse, Waveform
from softclose_workflows.analyses.certify import certify
from softclose_workflows.analyses.distinct import distinct, last_change_us
from softclose_workflows.report.data import ReportData
from softclose_workflows.report.drive_picture import drive_picture
from softclose_workflows.report.gather import gather
from softclose_workflows.report.headline import found_by, headline
from softclose_workflows.report.health import Check, health
from softclose_workflows.report.page import render_report
from softclose_workflows.report.summary import candidate_rows
from softclose_workflows.tell import labels
from softclose_workflows.tell.assumptions import assumptions


@pytest.fixture(scope="module")
def data() -> ReportData:
    return gather(hostile_store())


@pytest.fixture(scope="module")
def certified(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    copy = str(shutil.copytree(hostile_store(), tmp_path_factory.mktemp("headline") / "certified.zarr"))
    certify(copy, n_switches=2000, top=2)
    return gather(copy, learned=False, picks=False)


@pytest.mark.parametrize("kind", ["data", "certified"])
def test_speed_and_share_open_stand_beside_those_of_both_references(kind: str, request: pytest.FixtureRequest) -> None:
    found: ReportData = request.getfixturevalue(kind)
    rows = headline(found)["rows"]
    assert [row["kind"] for row in rows] == ["best", "reference", "difference", "reference", "difference"]
    designs = found.judged_designs
    for row, design in zip((rows[0], rows[1], rows[3]), designs, strict=True):
        a = design.assessment
        assert row["cells"][0] == labels.estimated(a.v_u_cm_s, *a.v_u_interval, "cm/s")
        assert row["cells"][1] == labels.estimated_share(a.p_nc, *a.p_nc_intervals.wilson)
    for row, design in zip((rows[2], rows[4]), designs[1:], strict=True):
        assert row["cells"][0][0] == (
            f"{labels.signed(designs[0].assessment.v_u_cm_s - design.assessment.v_u_cm_s, 2)} cm/s"
        )
        share = designs[0].assessment.p_nc - design.assessment.p_nc
        assert row["cells"][1][0] == f"{labels.signed(100.0 * share, 2)} points"
    page = render_report(found)
    first = page[page.index('id="headline"') : page.index('id="design"')]
    for row in rows:
        for value, bounds in row["cells"]:
            assert value in first
            assert bounds in first
    assert f"{100 * designs[0].assessment.confidence:g} % interval" in first or kind == "data"


def test_a_campaign_without_a_usable_candidate_has_no_headline_and_a_page_that_says_so(data: ReportData) -> None:
    n = len(data.candidates)
    candidates = dataclasses.replace(data.candidates, failed=np.ones(n, dtype=bool))
    none = dataclasses.replace(
        data,
        best=None,
        designs=(),
        dependence=None,
        front=None,
        places=(),
        shares={},
        samples={},
        candidates=candidates,
    )
    assert headline(none) == {}
    assert "No candidate has a usable result yet" in render_report(none)


def test_the_share_that_is_too_fast_is_that_of_the_limit_in_its_heading(data: ReportData) -> None:
    """The first of the limits that a campaign asks about."""
    response = data.designs[0].response
    told = assess(response, limits_cm_s=(10.0, 25.0))
    assert told.p_exceed[0].limit_cm_s == 10.0 != told.p_exceed[1].limit_cm_s
    designs = (dataclasses.replace(data.designs[0], assessment=told), *data.designs[1:])
    top = headline(dataclasses.replace(data, designs=designs))
    assert top["limit"] == 10.0
    assert top["rows"][0]["cells"][3] == labels.estimated_share(
        told.p_exceed[0].probability.estimate, *told.p_exceed[0].probability.wilson
    )


def test_nothing_is_said_of_pairs_where_no_switch_touches_under_both(data: ReportData) -> None:
    none = np.full_like(data.designs[1].response.max_contact_speed, math.nan)
    silent = dataclasses.replace(data.designs[1].response, max_contact_speed=none)  # type: ignore[type-var]
    of_none = dataclasses.replace(data.designs[1], response=silent, assessment=assess(silent))
    designs = (data.designs[0], of_none)
    row = headline(dataclasses.replace(data, designs=designs))["rows"][2]
    assert (row["pairs"], row["softer"]) == ("", "")


def test_the_table_of_certified_designs_tells_what_training_had_promised_and_how_much_was_too_much(
    certified: ReportData,
) -> None:
    """A training score and its optimism have as many digits as anybody reads: their sum is g on the new switches."""
    c = certified.certification
    assert c is not None
    told = headline(certified)["certified"]
    for row, design in zip(told["rows"], (*c.candidates, *c.references), strict=True):
        if design.training is None:
            assert (row["training"], row["optimism"]) == ("–", "–")
            continue
        assert {len(row[key].partition(".")[2]) for key in ("training", "optimism")} == {2}
        training, optimism = (float(row[key].replace("−", "-")) for key in ("training", "optimism"))
        assert training + optimism == pytest.approx(design.assessment.g_cm_s, abs=0.011)
    assert told["stale"] == 0
    earlier = dataclasses.replace(c.request, committed=c.committed - 3)
    sooner = dataclasses.replace(certified, certification=dataclasses.replace(c, request=earlier))
    assert headline(sooner)["certified"]["stale"] == 3


def test_certified_differences_are_the_certificate_s(certified: ReportData) -> None:
    c = certified.certification
    assert c is not None
    rows = headline(certified)["rows"]
    for row, reference in zip((rows[2], rows[4]), reversed(c.references), strict=True):
        pair = c.comparison(reference)
        low, high = (100.0 * end for end in pair.p_nc_interval)
        assert row["cells"][1] == labels.estimated_difference(100.0 * pair.p_nc, low, high, "points")
        assert row["cells"][0] == labels.estimated_difference(pair.v_u_cm_s, *pair.v_u_interval, "cm/s")


def test_differences_have_no_interval_where_training_switches_are_not_independent(data: ReportData) -> None:
    population = dataclasses.replace(data.config.population, sampling="replicated")
    changed = dataclasses.replace(data, config=dataclasses.replace(data.config, population=population))
    differences = [row for row in headline(changed)["rows"] if row["kind"] == "difference"]
    assert all(bounds == "" for row in differences for _, bounds in row["cells"])
    assert all(value != "" for row in differences for value, _ in row["cells"])


@pytest.mark.parametrize(
    ("preset", "settings", "said"),
    [
        ("current", (), "The amplifier is ideal"),
        ("current", (), "one mode of vibration and no damping"),
        ("current-trim", (), "two measurements a part: its pull-in voltage, to 1 %, and its resonance, to 1 %"),
        ("current-trim-pull-in", (), "one measurement a part: its pull-in voltage"),
        ("current", ("trim.measured=contact times", "trim.actuations=7"), "7 actuations a part"),
        ("current-trim", ("trim.bins=16",), "16 bins share a drive"),
        ("current", ("amplifier.bandwidth_kHz=250",), "bandwidth 250 kHz"),
        ("current", ("amplifier.gain_error=0.02",), "gain by 2 %"),
        ("current", ("amplifier.time_error=0.01",), "clock by 1 %"),
        ("current-damped", (), "a quality factor of"),
        ("current-two-modes", (), "the reduced-order model"),
        ("current-temperature", (), "the worst of"),
        ("current-opening", (), "released at"),
    ],
)
def test_every_condition_is_said_to_be_assumed(preset: str, settings: tuple[str, ...], said: str) -> None:
    lines = assumptions(load_config(preset, list(settings)))
    assert any(said in line for line in lines), lines
    assert all(line[0].isupper() and line.endswith(".") for line in lines)


def test_what_is_measured_on_every_part_is_said_first() -> None:
    assert "measurement" in assumptions(load_config("current-trim"))[0]
    assert not any("measurement" in line for line in assumptions(load_config("current")))


def checks(data: ReportData) -> dict[str, Check]:
    return {check.name: check for check in health(data)}


def test_health_of_a_finished_campaign(data: ReportData, certified: ReportData) -> None:
    found = checks(data)
    assert found["Budget"].good
    assert not found["Intervals"].good
    assert "optimistic" in found["Intervals"].said
    covers = checks(certified)["Intervals"]
    assert covers.good
    assert "no error of the device model, and no lot that is distributed otherwise" in covers.said
    assert "leav" in found["Surrogate"].said or "left out" in found["Surrogate"].said


def test_failed_candidates_stand_ins_and_an_open_budget_ask_for_attention(data: ReportData) -> None:
    growing = dataclasses.replace(data, n_total=data.n_total + 5)
    assert not checks(growing)["Budget"].good
    n = len(data.candidates)
    failed = dataclasses.replace(data.candidates, failed=np.arange(n) == 0)
    said = checks(dataclasses.replace(data, candidates=failed))["Budget"]
    assert (said.good, "1 of them failed" in said.said) == (False, True)
    origin = ("fallback: sobol", *data.candidates.origin[1:])
    said = checks(dataclasses.replace(data, candidates=dataclasses.replace(data.candidates, origin=origin)))["Budget"]
    assert (said.good, "1 replace a proposal" in said.said) == (False, True)


@pytest.mark.parametrize(("last", "good"), [(19.95, True), (19.5, False)])
def test_a_campaign_that_still_improves_at_its_end_has_not_converged(data: ReportData, last: float, good: bool) -> None:
    n = len(data.candidates)
    g = np.array([*np.full(n - 1, 20.0), last])
    columns = data.candidates.columns | {"g_cm_s": g, "rank_cm_s": g}
    candidates = dataclasses.replace(data.candidates, columns=columns, failed=np.zeros(n, dtype=bool))
    said = checks(dataclasses.replace(data, candidates=candidates))["Convergence"]
    assert said.good is good
    assert labels.number(20.0 - last, 2) in said.said


def test_a_surrogate_that_is_surer_than_it_should_be_is_told(data: ReportData) -> None:
    assert data.dependence is not None
    left = data.dependence.left_out
    sure = dataclasses.replace(left, sd_cm_s=left.sd_cm_s * 0.0 + 1e-9)
    changed = dataclasses.replace(data, dependence=dataclasses.replace(data.dependence, left_out=sure))
    assert not checks(changed)["Surrogate"].good
    wide = dataclasses.replace(left, sd_cm_s=left.sd_cm_s * 0.0 + 1e9)
    changed = dataclasses.replace(data, dependence=dataclasses.replace(data.dependence, left_out=wide))
    assert checks(changed)["Surrogate"].good


def test_the_first_screen_says_what_the_prior_promised_and_health_how_sure_the_process_was(data: ReportData) -> None:
    assert data.best is not None
    many = {name: np.resize(values, 40) for name, values in data.candidates.columns.items()}
    many["g_cm_s"] = 15.0 + np.resize([0.05, 0.15, 0.05, 0.15, 0.05, 0.05, 0.15, 0.05, 0.05, 0.35], 40)

    def told(deviation: float) -> ReportData:
        said = {"prior_g_cm_s": np.full(40, 14.5), "predicted_g_cm_s": np.full(40, 15.0)}
        said["predicted_sd_cm_s"] = np.full(40, deviation)
        failed = np.zeros(40, dtype=bool)
        sizes = np.full(40, data.candidates.n_switches[0])
        candidates = dataclasses.replace(
            data.candidates,
            surrogate=said,
            columns=many,
            failed=failed,
            n_switches=sizes,
            origin=("trust-region",) * 40,
        )
        return dataclasses.replace(data, candidates=candidates)

    text = found_by(told(0.1))
    assert (
        "had promised g = 14.50 cm/s of it, the Gaussian process, which proposes candidates, expected 15.00 ± 0.10 "
        f"cm/s; it came to {many['g_cm_s'][data.best]:.2f} cm/s on the training switches."
    ) in text
    for deviation, good in ((0.1, True), (0.02, False), (1.0, False)):
        check = checks(told(deviation))["Deviations"]
        assert check.good is good, check.said
    shares = f"{labels.percent(0.6, 0)} came within one and {labels.percent(0.9, 0)} within two"
    assert shares in checks(told(0.1))["Deviations"].said
    assert "promised" not in found_by(data)
    assert "Deviations" not in checks(data)  # eight candidates


def test_equally_good_optima_are_told_from_one_that_nothing_comes_near(data: ReportData) -> None:
    first, second = data.places[:2]
    best = float(data.candidates.columns["g_cm_s"][first])
    near, far = "a rather different waveform is practically as good", "no rather different waveform that was tried"
    assert 0.02 * best > 0.09
    for apart, half, said in (
        (0.1, 1.0, "equally good"),
        (-0.1, 1.0, "equally good"),
        (0.08, 0.04, near),  # 0.08 cm/s is nothing that stands alone, however narrow the interval
        (0.019 * best, 0.0, near),
        (0.021 * best, 0.0, far),
        (50.0, 1.0, far),
    ):
        g = data.candidates.columns["g_cm_s"].copy()
        g[second] = g[first] + apart
        columns = data.candidates.columns | {
            "g_cm_s": g,
            "g_lower_cm_s": g - half,
            "g_upper_cm_s": g + half,
        }
        candidates = dataclasses.replace(data.candidates, columns=columns)
        found = checks(dataclasses.replace(data, candidates=candidates))["Optima"].said
        assert said in found
        than = f"{labels.number(abs(apart), 2)} cm/s {'higher' if apart > 0.0 else 'lower'}"
        assert f"candidate {second}, whose g on the training switches is {than}" in found
        assert "stands alone" not in found


def waveform(volts: float) -> Waveform:
    return Waveform(
        pulses=(
            Pulse(start_us=0.0, rise_us=4.0, peak_us=3.0, volts=volts),
            Pulse(start_us=12.0, rise_us=9.0, peak_us=math.inf, volts=80.0),
        )
    )


def test_the_picture_shows_the_drive_until_a_little_after_its_last_change() -> None:
    drawn = drive_picture(waveform(120.0), 250.0, 150.0)
    points = np.array([p.split(",") for p in re.findall(r'points="([^"]*)"', drawn)[0].split()], dtype=float)
    levels = [float(y) for y in re.findall(r'class="rule"[^>]*y1="([\d.]+)"', drawn)]
    zero, limit = levels
    at = waveform(120.0)
    volts = (zero - points[:, 1]) / (zero - limit) * 150.0
    assert volts.max() == pytest.approx(120.0, abs=0.2)
    assert volts[0] == pytest.approx(0.0, abs=0.1)
    assert volts[-1] == pytest.approx(80.0, abs=0.1)
    until = float(re.findall(r"Drive voltage over ([\d.]+) µs", drawn)[0])
    assert 41.0 <= until <= 60.0
    t = (points[:, 0] - points[0, 0]) / (points[-1, 0] - points[0, 0]) * until
    np.testing.assert_allclose(volts, at.voltage(t), atol=1.5)


@pytest.mark.parametrize("horizon", [5.0, 40.0, 250.0, 3000.0])
def test_the_picture_has_few_ticks_at_any_horizon(horizon: float) -> None:
    slow = Waveform(pulses=(Pulse(start_us=0.0, rise_us=0.7 * horizon, peak_us=math.inf, volts=80.0),))
    assert 4 <= drive_picture(slow, horizon, 150.0).count('class="tick"') <= 11


def test_near_copies_are_no_other_place() -> None:
    many = [waveform(120.0), waveform(121.0), waveform(140.0), waveform(139.0)]
    until = last_change_us(many[0], 250.0)
    assert until == pytest.approx(41.0)
    assert last_change_us(many[0], 30.0) == 30.0

    def chosen(apart: float, most: int = 9) -> list[int]:
        return distinct(range(4), many.__getitem__, until_us=until, apart_V=apart, most=most)

    assert chosen(5.0) == [0, 2]
    assert chosen(0.0) == [0, 1, 2, 3]
    assert chosen(0.0, most=2) == [0, 1]
    assert chosen(1e6) == [0]


def test_a_campaign_for_a_front_shows_it_first_and_labels_its_candidates(data: ReportData) -> None:
    assert data.front is not None
    optimiser = dataclasses.replace(data.config.optimiser, engine="nsga2")
    of_front = dataclasses.replace(data, config=dataclasses.replace(data.config, optimiser=optimiser))
    rows = candidate_rows(of_front)
    n = len(data.front.candidates)
    assert {row["index"] for row in rows[:n]} == {*data.front.candidates}
    assert [row["on_front"] for row in rows] == [True] * n + [False] * (len(rows) - n)
    assert not any(row["on_front"] for row in candidate_rows(data))
    for shown, first in ((of_front, "front"), (data, "design")):
        page = render_report(shown)
        places = {name: page.index(f'<section id="{name}"') for name in ("front", "design")}
        assert min(places, key=lambda name: places[name]) == first


def test_the_page_says_how_they_close_and_what_a_drive_that_is_a_little_off_does(
    data: ReportData, certified: ReportData
) -> None:
    for found, n in ((data, 3), (certified, 3)):
        rows = headline(found)["closing"]
        assert len(rows) == n
        for row, design in zip(rows, found.judged_designs, strict=True):
            touched = np.asarray(design.response.n_impacts) > 0  # type: ignore[attr-defined]
            for cell, values in ((row[1], design.response.first_contact_us), (row[3], design.response.n_impacts)):  # type: ignore[attr-defined]
                ordered = np.sort(np.asarray(values)[touched])
                at = math.ceil(0.9 * ordered.size) - 1
                assert float(cell[0].removesuffix(" µs")) == pytest.approx(ordered[at], abs=0.051)
            a = design.assessment
            assert row[2] == labels.estimated(a.closing_us, *a.closing_interval, "µs", 1)
        page = render_report(found)
        first = page[page.index('id="headline"') : page.index('id="design"')]
        assert all(cell[0] in first for row in rows for cell in row)
    assert headline(data)["drive_off"] == []
    certification = certified.certification
    assert certification is not None
    off = headline(certified)["drive_off"]
    assert [row[0][0] for row in off] == ["Volts −3 %", "Volts −1 %", "Volts as designed", "Volts +1 %", "Volts +3 %"]
    for row, said in zip(certification.drive_off, off, strict=True):
        a = row.assessment
        assert said[1] == labels.estimated(a.v_u_cm_s, *a.v_u_interval, "cm/s")
        assert said[2] == labels.estimated_share(a.p_nc, *a.p_nc_intervals.wilson)
    page = render_report(certified)
    first = page[page.index('id="headline"') : page.index('id="design"')]
    assert all(cell[0] in first for row in off for cell in row)
    assert "on all 2,000 new switches" in first
    assert "Compare these rows" not in first  # they are of the same switches as the figures above
