"""Claims about the page that a customer's engineer reads: it is understood rightly at the first look."""

from __future__ import annotations

import dataclasses
import html
import math
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from reported import hostile_store
from small_campaigns import finish
from softclose import load_config
from softclose.metrics.open_kinds import open_kinds
from softclose_workflows import api
from softclose_workflows.analyses.certify import certify
from softclose_workflows.analyses.drive_off import few_lines
from softclose_workflows.analyses.own_limits import own_limits
from softclose_workflows.cli import main
from softclose_workflows.report.data import ReportData
from softclose_workflows.report.gather import gather
from softclose_workflows.report.glossary import glossary
from softclose_workflows.report.headline import headline
from softclose_workflows.report.page import render_report
from softclose_workflows.run.creation import create_store

ROOT = Path(__file__).parents[2]
N = 2000


@pytest.fixture(scope="module")
def certified(tmp_path_factory: pytest.TempPathFactory) -> str:
    copy = str(shutil.copytree(hostile_store(), tmp_path_factory.mktemp("trusted") / "certified.zarr"))
    certify(copy, n_switches=N, top=3)
    return copy


@pytest.fixture(scope="module")
def data(certified: str) -> ReportData:
    return gather(certified)


@pytest.fixture(scope="module")
def page(data: ReportData) -> str:
    return render_report(data)


def text_of(page: str) -> str:
    """What a reader sees, without the scripts."""
    plain = re.sub(r"<(script|style).*?</\1>", "", page, flags=re.DOTALL)
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", plain)))


def first_screen(page: str) -> str:
    return text_of(page[page.index('id="headline"') : page.index('id="design"')])


def digits_in(text: str) -> set[int]:
    """How many digits each number of a text has behind its point."""
    return {len(found) for found in re.findall(r"\d(?:\.(\d+))?(?![\d.])", text.replace(",", ""))}


def test_every_figure_of_the_page_has_as_many_digits_as_its_interval(page: str) -> None:
    """14.35 beside 14.3-14.4 leaves a reader to guess which of the two is rounded."""
    cells = re.findall(r'<td[^>]*>([^<]+)<span class="interval">([^<]+)</span>', page)
    cells += re.findall(r'<td class="n">([^<]+)</td><td class="n interval">([^<]+)</td>', page)
    pairs = [(value, bounds) for value, bounds in cells if re.search(r"\d", bounds) and "that touch" not in bounds]
    pairs += re.findall(r"([−\d][\d.,]*) ?\u202f?%? \(([−+\d][\d.,]*(?:–| to )[−+\d][\d.,]*)\)", text_of(page))
    assert len(pairs) > 40
    for value, bounds in pairs:
        assert len(digits_in(value) | digits_in(bounds)) == 1, (value, bounds)


def test_a_difference_of_means_is_said_to_be_of_the_switches_that_touch_under_both(
    data: ReportData, page: str, certified: str
) -> None:
    c = data.certification
    assert c is not None
    missing = 0
    for reference in c.references:
        pair = c.comparison(reference)
        both = np.isfinite(c.best.response.max_contact_speed) & np.isfinite(reference.response.max_contact_speed)
        assert pair.softer.n == int(both.sum())
        subtracted = c.best.assessment.mean_cm_s - reference.assessment.mean_cm_s
        missing += abs(subtracted - pair.mean_cm_s) > 0.01
        assert f"of the {int(both.sum()):,} that touch under both" in first_screen(page)
    assert missing, "or the difference of the two means could as well be printed"
    assert "so it is not the one mean minus the other" in first_screen(page)
    said = " ".join(CliRunner().invoke(main, ["certify", certified, "--switches", str(N), "--top", "3"]).output.split())
    assert f"of the {pair.softer.n:,} switches that touch under both, mean V of these" in said


def test_where_all_switches_touch_means_subtract_and_nothing_is_said(data: ReportData) -> None:
    everywhere = dataclasses.replace(data, certification=None, designs=(data.designs[1], data.designs[1]))
    assert all(np.isfinite(d.speed_cm_s).all() for d in everywhere.designs), "a plain step reaches all of them"
    top = headline(everywhere)
    assert not top["paired"]
    assert [row["pairs"] for row in top["rows"]] == ["", "", ""]


def test_the_page_says_how_the_open_switches_split(data: ReportData, page: str, certified: str) -> None:
    c = data.certification
    assert c is not None
    said = open_kinds(c.best.response).sentence
    assert said[1:] in first_screen(page)
    for arguments in ([], ["--json"]):
        done = CliRunner().invoke(main, ["certify", certified, "--switches", str(N), "--top", "3", *arguments])
        assert (said if not arguments else f'"n_open": {open_kinds(c.best.response).n_open}') in done.output
    assert said in repr(api.certify(certified, n_switches=N, top=3))


def test_the_page_warns_of_a_slow_closing_and_of_a_better_reference(data: ReportData) -> None:
    """References are known to the warnings by their role: by the name on the page none was ever given."""
    best, *others = data.designs
    slow = dataclasses.replace(best, assessment=dataclasses.replace(best.assessment, closing_us=200.0))
    quick = [
        dataclasses.replace(d, assessment=dataclasses.replace(d.assessment, closing_us=30.0, rank_cm_s=math.inf))
        for d in others
    ]
    warnings = headline(dataclasses.replace(data, certification=None, designs=(slow, *quick)))["warnings"]
    assert any("takes 200 µs to close, a step 30" in line for line in warnings)
    better = [dataclasses.replace(d, assessment=dataclasses.replace(d.assessment, rank_cm_s=-1.0)) for d in others]
    warnings = headline(dataclasses.replace(data, certification=None, designs=(best, *better)))["warnings"]
    for name in ("unshaped", "deterministic"):
        assert any(line.startswith(f"the {name} design is better") for line in warnings), warnings


def limited_store(folder: Path, **objective: Any) -> str:
    config = load_config({
        "campaign": {"budget": 1}, "population": {"n_switches": 60}, "optimiser": {"engine": "sobol"},
        "waveform": {"initial": [[[0.0, 4.0, "hold", 90.0]]]}, "store": {"n_times": 3}, "objective": objective,
    })  # fmt: skip
    path = str(folder / "limited.zarr")
    create_store(config, path)
    finish(Path(path))
    certify(path, n_switches=400, top=1)
    return path


def test_limits_of_the_campaign_pass_or_fail(tmp_path: Path) -> None:
    limits = {"hold_margin": 40.0, "peak": 95.0, "closing": 1.0}
    path = limited_store(tmp_path, quantity_limits=limits, max_open=0.9, form="chance", p_max=0.001)
    found = gather(path, learned=False, picks=False)
    c = found.certification
    assert c is not None
    verdicts = {limit.setting: limit.verdict for limit in own_limits(
        found.config, c.best.response, c.best.assessment, fresh=True
    )}  # fmt: skip
    assert verdicts == {
        "objective.p_max": {"met": "pass", "exceeded": "fail"}[c.best.assessment.limit.verdict],  # type: ignore[union-attr]
        "objective.max_open": "pass",
        "objective.quantity_limits.hold_margin": "fail",
        "objective.quantity_limits.peak": "pass",
        "objective.quantity_limits.closing": "fail",
    }
    shown = first_screen(render_report(found))
    assert "given no limits" not in shown
    for setting, verdict in verdicts.items():
        assert re.search(rf"\({re.escape(setting)}\)[^()]*? {verdict}", shown), setting
    done = CliRunner().invoke(main, ["certify", path, "--switches", "400", "--top", "1"]).output
    assert "limit objective.quantity_limits.peak, largest voltage commanded at most 95.00 V: pass, 90.00 V (exact)" in (
        " ".join(done.split())
    )


def test_a_campaign_without_limits_says_that_nothing_passes_or_fails(data: ReportData) -> None:
    objective = dataclasses.replace(data.config.objective, max_open=1.0)
    without = dataclasses.replace(data, config=dataclasses.replace(data.config, objective=objective))
    assert headline(without)["limits"] == []
    assert "given no limits, so nothing passes or fails here" in first_screen(render_report(without))


def test_the_reference_designs_have_their_pulses_on_the_page(data: ReportData, page: str) -> None:
    rows = {design["role"]: design["pulses"] for design in headline(data)["references"]}
    assert set(rows) == {"unshaped", "deterministic"}
    shown = first_screen(page)
    for pulse in rows["deterministic"]:
        assert " ".join(pulse.values()) in re.sub(r" +", " ", shown)
    assert "closes the mean switch without impact and takes no account of the spread" in shown


def test_why_the_best_of_the_page_is_not_the_first_of_the_table_is_said_where_it_is_seen(data: ReportData) -> None:
    c = data.certification
    assert c is not None
    first = data.candidates.ranked[0]
    other = next(d for d in c.candidates if d.candidate != first)
    assert other.candidate is not None
    differs = dataclasses.replace(data, best=other.candidate)
    said = headline(differs)["ranked"]
    assert f"candidate {first} is first" in said
    assert f"candidate {other.candidate} is the best on the {N:,} new switches" in said
    g = {d.candidate: f"{d.assessment.g_cm_s:.2f}" for d in c.candidates}
    assert f"(g = {g[other.candidate]} against {g[first]} cm/s)" in said
    shown = render_report(differs)
    table = shown[shown.index('id="candidates"') : shown.index('<table id="table"')]
    assert html.escape(said) in table
    assert "<details" not in table
    assert headline(dataclasses.replace(data, best=first))["ranked"] == ""
    assert headline(dataclasses.replace(data, certification=None))["ranked"] == ""


def test_every_word_of_the_page_is_explained_on_it_and_in_the_glossary_of_the_site(data: ReportData, page: str) -> None:
    words = glossary(data)
    site = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").lower()
    terms = set(re.findall(r"\*\*([^*]+)\*\*:", site))
    known = {part.strip() for term in terms for part in term.split(",")}
    for key, (term, meaning) in words.items():
        assert f'id="w-{key}"' in page
        assert html.escape(meaning) in page
        if key != "limit":
            assert {part.strip().lower() for part in term.split(",")} <= known, term
    used = set(re.findall(r'href="#w-([^"]+)"', page))
    assert used <= set(words)
    assert {
        "g",
        "certified",
        "deterministic",
        "unshaped",
        "limit",
        "lot",
        "v_u",
        "open",
        "interval",
        "candidate",
    } <= used
    assert "one percentage point more left open counts as 0.25 cm/s" in first_screen(page)


def test_health_says_what_it_asks_for_beside_what_it_found(data: ReportData) -> None:
    """A tick beside 88 % is read as a mistake where only `95 % of normal errors` stands there."""
    found = {check.name: check.said for check in headline(data)["health"]}
    assert "at least 85\u202f% is asked for" in found["Surrogate"]
    said = "no more than 0.10 is asked for"
    assert said in found.get("Convergence", said)


def test_what_only_a_mouse_can_do_is_not_printed(page: str) -> None:
    for hint in ("Drag to zoom", "Click a point"):
        assert re.search(rf'<span class="screen">{hint}[^<]*</span></figcaption>', page)
        assert page.count(hint) == 1
    style = (ROOT / "workflows/softclose_workflows/report/assets/page.css").read_text(encoding="utf-8")
    printed = style[style.index("@media print {") :]
    assert ".screen" in printed[: printed.index("display: none !important")]


def test_no_legend_calls_the_hardest_tenth_too_hard(page: str) -> None:
    assert "too hard" not in text_of(page)
    assert "among the hardest 10 % of those that touch (V above v u )" in text_of(page)


def test_rows_on_fewer_switches_than_the_figures_above_say_so() -> None:
    assert few_lines(4000, 4000) == []
    (line,) = few_lines(4000, 100_000)
    assert "Compare these rows with each other" in line
    assert "100,000" in line
