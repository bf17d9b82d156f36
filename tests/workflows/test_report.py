"""Claims about `softclose report`: what its page holds, and that strangers' text stays text."""

from __future__ import annotations

import base64
import dataclasses
import json
import math
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.stats import binomtest

from reported import HOSTILE, empty_store, hostile_store
from small_campaigns import FINISHED, make_campaign
from softclose.waveform import Pulse, Waveform
from softclose_store import open_campaign
from softclose_workflows.analyses.certify import certify
from softclose_workflows.cli import main
from softclose_workflows.report import charts, packed, shapes, summary
from softclose_workflows.report.data import ReportData, Traces
from softclose_workflows.report.gather import gather
from softclose_workflows.report.page import render_report
from softclose_workflows.report.sections.amplifier import delivered_chart
from softclose_workflows.tell import labels

LARGEST_BYTES = 8_000_000


@pytest.fixture(scope="module")
def store() -> str:
    return hostile_store()


@pytest.fixture(scope="module")
def data(store: str) -> ReportData:
    return gather(store)


@pytest.fixture(scope="module")
def page(data: ReportData) -> str:
    return render_report(data)


class Outline(HTMLParser):
    """Elements, the addresses that they refer to, and the texts of charts."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.alts: list[str] = []
        self.ids: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        found = dict(attributes)
        self.addresses += [value or "" for name, value in attributes if name in ("src", "href", "srcset", "action")]
        self.ids += [found["id"] or ""] if "id" in found else []
        if found.get("role") == "img":
            self.alts.append(found.get("aria-label") or "")


def outline(page: str) -> Outline:
    parser = Outline()
    parser.feed(page)
    return parser


def payload(page: str) -> dict[str, object]:
    match = re.search(r'<script type="application/json" id="page-data">(.*?)</script>', page, re.S)
    assert match is not None
    loaded: dict[str, object] = json.loads(match[1])
    return loaded


def test_page_refers_to_nothing_outside_itself(page: str) -> None:
    assert all(address.startswith("#") for address in outline(page).addresses)
    assert {"link", "iframe", "object", "embed", "img"}.isdisjoint(outline(page).tags)
    assert "default-src 'none'; base-uri 'none'; form-action 'none'" in page


def test_page_stays_small(page: str) -> None:
    assert len(page.encode()) < LARGEST_BYTES


def test_only_the_two_scripts_that_the_policy_names_may_run(page: str) -> None:
    import hashlib

    scripts = re.findall(r"<script>(.*?)</script>", page, re.S)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    digests = {base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts}
    assert digests == set(re.findall(r"'sha256-([^']*)'", policy[1].replace("&#39;", "'")))


def test_strangers_text_stays_text(page: str, data: ReportData) -> None:
    assert data.config.campaign.name == HOSTILE
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "{{ 7 * 7 }}" in page


def test_every_chart_has_a_text_for_those_who_cannot_see_it(page: str) -> None:
    alts = outline(page).alts
    assert len(alts) > 15
    assert all(len(text) > 30 for text in alts)


def test_every_section_of_the_issue_is_there(page: str) -> None:
    wanted = {
        "headline",
        "design",
        "speeds",
        "switches",
        "population",
        "convergence",
        "learned",
        "candidates",
        "provenance",
    }
    assert wanted | {"provenance"} <= set(outline(page).ids)
    assert len(set(outline(page).ids)) == len(outline(page).ids)


def test_uncertified_page_warns_that_training_scores_are_optimistic(page: str) -> None:
    assert "Not certified" in page
    assert "optimistic" in page


def test_certified_page_heads_with_the_certified_figures(store: str, tmp_path: Path) -> None:
    copy = str(shutil.copytree(store, tmp_path / "certified.zarr"))
    certify(copy, n_switches=3000, top=2)
    data = gather(copy, learned=False, picks=False)
    page = render_report(data)
    assert data.certification is not None
    best = data.certification.best.assessment
    assert "Not certified" not in page
    for text in labels.estimated(best.v_u_cm_s, *best.v_u_interval, "cm/s"):
        assert text in page
    assert "3,000 new simulated switches" in page


def test_page_of_an_empty_store_says_so(tmp_path: Path) -> None:
    page = render_report(gather(empty_store(tmp_path)))
    assert "No candidate is committed yet" in page
    assert "0 of 8 candidates" in page


def test_picked_candidates_carry_the_stored_motion(store: str, data: ReportData, page: str) -> None:
    from softclose_store import open_campaign

    campaign = open_campaign(store)
    picks = payload(page)["picks"]
    assert isinstance(picks, dict)
    assert sorted(int(i) for i in picks) == [i for i in range(8) if np.isfinite(campaign.records()["g_cm_s"][i])]
    i = next(i for i in data.places if i != data.best)
    traces = picks[str(i)]["traces"]
    codes = np.frombuffer(base64.b64decode(traces["x"]["codes"]), dtype="<u2")
    distance = traces["x"]["low"] + traces["x"]["step"] * codes.reshape(traces["n"], -1)
    motion = campaign.trajectories(i)
    shown = np.searchsorted(motion.times_us, np.asarray(traces["times"]) - 1e-6)
    stored = campaign.population()["D"][: traces["n"], None] - motion.x[: traces["n"]][:, shown]
    np.testing.assert_allclose(distance, stored, atol=1e-4)


def test_speeds_of_a_report_are_in_cm_s_and_times_in_us(data: ReportData, store: str) -> None:
    campaign = open_campaign(store)
    assert data.best is not None
    responses = campaign.responses(data.best)
    best = data.designs[0]
    np.testing.assert_allclose(best.speed_cm_s, 100.0 * responses.max_contact_speed)
    assert np.nanmax(best.speed_cm_s) == pytest.approx(best.assessment.max_cm_s)
    for design in data.designs:  # a switch that is slammed shut is no slower than 1 and no faster than 200 cm/s
        assert 1.0 < np.nanquantile(design.speed_cm_s, 0.9) < 200.0
        assert np.nanquantile(design.speed_cm_s, 0.9) == pytest.approx(design.assessment.v_u_cm_s, rel=0.02)
    traces = best.traces
    assert traces is not None
    motion = campaign.trajectories(data.best)
    step = round((traces.times_us[1] - traces.times_us[0]) / (campaign.times_us[1] - campaign.times_us[0]))
    n = len(traces.rows)
    np.testing.assert_array_equal(traces.times_us, campaign.times_us[::step])
    np.testing.assert_allclose(traces.velocity_cm_s, 100.0 * motion.v[:n, ::step], rtol=1e-6)
    assert responses.impact_speed is not None
    assert responses.impact_time_us is not None
    np.testing.assert_allclose(traces.impact_cm_s, 100.0 * responses.impact_speed[:n])
    np.testing.assert_array_equal(traces.impact_us, responses.impact_time_us[:n])
    first, last = data.edges_cm_s[[0, -1]]
    assert first == 0.0
    assert last >= np.nanmax(best.speed_cm_s)
    shown = float(np.mean((best.speed_cm_s >= first) & (best.speed_cm_s <= last)))
    assert data.shares[data.best].sum() == pytest.approx(100.0 * shown)


def test_packed_values_keep_gaps() -> None:
    values = np.array([[0.0, np.nan, 2.0], [1.0, -3.0, np.nan]])
    coded = packed.pack(values)
    codes = np.frombuffer(base64.b64decode(coded["codes"]), dtype="<u2").reshape(2, 3)
    back = np.where(codes == 65535, np.nan, coded["low"] + coded["step"] * codes)
    np.testing.assert_allclose(back, values, atol=5.0 / 65534)


def test_packed_traces_of_a_constant_motion_do_not_divide_by_zero() -> None:
    still = np.zeros((2, 3))
    none = np.empty((2, 0))
    traces = Traces(
        rows=np.arange(2),
        times_us=np.arange(3.0),
        distance_um=still,
        velocity_cm_s=still,
        closed=np.array([True, False]),
        impact_us=none,
        impact_cm_s=none,
    )
    coded = packed.pack_traces(traces)
    assert coded["impacts"] == []
    assert coded["open"] == [1]
    assert json.dumps(coded, allow_nan=False)


def test_waveform_points_meet_every_knot_and_draw_a_step_upright() -> None:
    ramped = Waveform([Pulse(0.0, 4.0, 5.0, 100.0), Pulse(20.0, 10.0, np.inf, 60.0)])
    times, volts = packed.waveform_points(ramped, 250.0)
    assert set(ramped.breakpoints(250.0)) <= set(times)
    np.testing.assert_array_equal(volts, ramped.voltage(times))
    times, volts = packed.waveform_points(Waveform([Pulse(10.0, 0.0, np.inf, 100.0)]), 250.0)
    rise = np.flatnonzero(np.diff(volts))
    assert len(rise) == 1
    assert np.diff(times)[rise[0]] < 1e-9


def test_density_is_a_density_and_keeps_off_negative_speeds() -> None:
    v = np.abs(np.random.default_rng(3).normal(2.0, 4.0, 2000))
    axis, density = shapes.speed_density(np.append(v, np.nan), 40.0)
    assert axis[0] == 0.0
    assert np.trapezoid(density, axis) == pytest.approx(1.0, abs=0.01)


def test_shares_and_switches_without_contact_add_up_to_the_ensemble() -> None:
    v = np.array([1.0, 2.5, 2.6, np.nan])
    assert shapes.shares(v, np.arange(5.0)).sum() == pytest.approx(75.0)


def test_best_so_far_starts_afresh_with_a_larger_ensemble(data: ReportData) -> None:
    n = len(data.candidates)
    g = np.linspace(30.0, 20.0, n)
    g[-2:] = 25.0, 24.0
    sizes = np.full(n, 60)
    sizes[-2:] = 600
    columns = data.candidates.columns | {"g_cm_s": g, "rank_cm_s": g, "g_lower_cm_s": g - 1.0, "g_upper_cm_s": g + 1.0}
    candidates = dataclasses.replace(data.candidates, columns=columns, n_switches=sizes, failed=np.zeros(n, dtype=bool))
    c = shapes.convergence(dataclasses.replace(data, candidates=candidates))
    assert c.best_cm_s.tolist() == [*g[:-2].tolist(), 25.0, 24.0]
    assert c.larger == ((n - 2, 600),)
    assert c.steps.tolist() == list(range(n))  # it changes with every candidate here
    flat = dataclasses.replace(c, best_cm_s=np.array([9.0, 9.0, 8.0, 8.0, 8.0]))
    assert flat.steps.tolist() == [0, 2, 4]
    chart = charts.convergence(dataclasses.replace(data, candidates=candidates))
    (mark,) = chart["layout"]["annotations"]
    assert (mark["x"], mark["text"]) == (n - 2, "600 switches from here ")


def test_candidates_on_the_largest_ensemble_come_first_and_a_page_lists_so_many(
    data: ReportData, monkeypatch: pytest.MonkeyPatch
) -> None:
    n = len(data.candidates)
    sizes = np.full(n, 60)
    sizes[2:4] = 600
    candidates = dataclasses.replace(data.candidates, n_switches=sizes)
    changed = dataclasses.replace(data, candidates=candidates)
    order = [row["index"] for row in summary.candidate_rows(changed)]
    g = data.candidates.columns["g_cm_s"]
    assert order == [*sorted((2, 3), key=lambda i: g[i]), *sorted({*range(n)} - {2, 3}, key=lambda i: g[i])]
    monkeypatch.setattr(summary, "MOST_ROWS", 3)
    page = render_report(changed)
    assert [int(i) for i in re.findall(r'<tr [^>]*data-candidate="(\d+)"', page)] == order[:3]
    assert f"The 3 best of {n}; " in page
    assert "Those on the largest ensemble come first" in page


def test_a_page_is_small() -> None:
    page = render_report(gather(hostile_store()))
    assert len(page.encode()) < 2_000_000


def test_a_failed_candidate_is_listed_with_its_reason_and_breaks_nothing(data: ReportData) -> None:
    n = len(data.candidates)
    victim = next(i for i in range(n) if i != data.best)
    failed = np.arange(n) == victim
    columns = {name: np.where(failed, np.nan, values) for name, values in data.candidates.columns.items()}
    notes = tuple("worker died three times" if f else "" for f in failed)
    shares = {i: found for i, found in data.shares.items() if i != victim}
    places = tuple(i for i in data.places if i != victim)
    candidates = dataclasses.replace(data.candidates, failed=failed, columns=columns, note=notes)
    page = render_report(dataclasses.replace(data, candidates=candidates, shares=shares, places=places))
    assert "worker died three times" in page
    assert f'data-show="{victim}"' not in page
    assert shapes.convergence(dataclasses.replace(data, candidates=candidates)).failed.tolist() == [float(victim)]


def test_quasi_random_ensembles_show_no_interval(tmp_path: Path) -> None:
    settings = (
        "campaign.budget=3",
        "prior.model=none",
        "optimiser.n_initial=3",
        "population.n_switches=64",
        "population.sampling=sobol",
    )
    data = gather(str(make_campaign(tmp_path / "sobol.zarr", *FINISHED, *settings)))
    assert not data.has_intervals
    page = render_report(data)
    assert "No interval is shown" in page
    assert "% interval" not in page.partition('id="page-data"')[0]
    assert np.isnan(shapes.convergence(data).lower_cm_s).all()


def test_palette_keeps_the_contrast_that_it_promises() -> None:
    def luminance(colour: str) -> float:
        parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    for theme in labels.PALETTE.values():
        assert theme.keys() == labels.PALETTE["light"].keys()
        for role in ("ink", "muted", *labels.SERIES):
            for paper in ("paper", "card"):
                high, low = sorted((luminance(theme[role]), luminance(theme[paper])), reverse=True)
                assert (high + 0.05) / (low + 0.05) >= 4.5, (role, paper)


def test_command_writes_the_page_and_says_where(store: str, tmp_path: Path) -> None:
    target = tmp_path / "page.html"
    result = CliRunner().invoke(main, ["report", store, "-o", str(target)])
    assert result.exit_code == 0, result.output
    assert str(target) in result.output
    assert target.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("where", ["missing-folder/page.html", "."])
def test_command_refuses_an_impossible_place_in_one_line(store: str, tmp_path: Path, where: str) -> None:
    result = CliRunner().invoke(main, ["report", store, "-o", str(tmp_path / where)])
    assert result.exit_code == 2
    assert "-o" in result.output
    assert "Traceback" not in result.output


def test_command_refuses_a_store_that_is_not_there(tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["report", str(tmp_path / "none.zarr"), "-o", str(tmp_path / "page.html")])
    assert result.exit_code == 2
    assert not (tmp_path / "page.html").exists()


def test_exceedance_counts_the_switches_that_touch_and_bounds_what_none_of_them_showed() -> None:
    speed = np.array([math.nan, *np.linspace(0.5, 20.0, 40)])
    found = shapes.exceedance(speed, 30.0, 0.9)
    for v in (0.0, 0.5, 10.25, 19.75, 20.0, 25.0):
        k = int(np.flatnonzero(found.v_cm_s == v)[0])
        count = int((speed > v).sum())
        assert found.probability[k] == count / 40
        exact = binomtest(count, 40).proportion_ci(0.9, method="exact")
        assert (found.lower[k], found.upper[k]) == pytest.approx((exact.low, exact.high), rel=1e-9)
    assert found.upper[-1] > 0.0 == found.probability[-1]
    assert shapes.exceedance(np.full(3, math.nan), 30.0, 0.9).v_cm_s.size == 0


def test_exceedance_is_drawn_for_every_judged_design_on_an_axis_without_zero(data: ReportData) -> None:
    chart = charts.exceedance(data.judged_designs, data.config.objective.limits_cm_s, 60.0)
    named = [trace for trace in chart["data"] if trace.get("showlegend", True)]
    assert [trace["name"] for trace in named] == [charts.plain(d.name) for d in data.judged_designs]
    assert all(y is not None and y > 0.0 for trace in chart["data"] for y in trace["y"])
    assert [shape["x0"] for shape in chart["layout"]["shapes"]] == list(data.config.objective.limits_cm_s)


def test_what_an_amplifier_delivers_is_drawn_beside_what_is_commanded(tmp_path: Path) -> None:
    settings = (
        "campaign.budget=3",
        "prior.model=none",
        "optimiser.n_initial=3",
        "population.n_switches=64",
        "amplifier.bandwidth_kHz=60",
    )
    data = gather(str(make_campaign(tmp_path / "amplifier.zarr", *FINISHED, *settings)))
    assert data.best_design is not None
    chart = delivered_chart(data.best_design, data.config)
    commanded, delivered = (np.array(trace["y"], dtype=float) for trace in chart["data"])
    t = np.array(chart["data"][0]["x"])
    np.testing.assert_allclose(commanded, data.best_design.waveform.voltage(t), rtol=1e-3, atol=1e-2)
    assert delivered.max() < commanded.max()
    assert 'id="amplifier"' in render_report(data)


def test_without_an_amplifier_none_is_drawn(page: str) -> None:
    assert 'id="amplifier"' not in page


def test_a_page_is_the_same_whoever_simulates_its_references(store: str, tmp_path: Path) -> None:
    pages = []
    for k, where in enumerate((("--serial",), (), ("--workers", "2"))):
        target = tmp_path / f"{k}.html"
        done = CliRunner().invoke(main, ["report", store, "-o", str(target), "--quiet", *where])
        assert done.exit_code == 0, done.output
        pages.append(re.sub(r"\d\d:\d\d UTC", "", target.read_text("utf-8")))  # when it was written
    assert pages[0] == pages[1] == pages[2]
