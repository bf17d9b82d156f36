"""Claims about the report in a real browser: headless Chromium, driven through its DevTools protocol."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from reported import chromium, hostile_store
from softclose.waveform import Waveform
from softclose_store import open_campaign
from softclose_workflows.report.gather import gather
from softclose_workflows.report.page import render_report

pytestmark = [
    pytest.mark.skipif(chromium() is None, reason="needs chromium, which is not installed"),
    pytest.mark.timeout(240),
]

ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


class Visit:
    """One page in one browser, with everything that it said and asked for."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.said: list[str] = []
        self.requests: list[str] = []
        page.on("console", lambda message: self.said.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: self.said.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))

    def until(self, condition: str) -> None:
        """Wait until a function of the page is true. Playwright's own way evaluates text, which the policy forbids."""
        deadline = time.monotonic() + 30.0
        while not self.page.evaluate(condition):
            assert time.monotonic() < deadline, condition
            time.sleep(0.05)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(render_report(gather(hostile_store())), encoding="utf-8")
    return path.as_uri()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as p:
        yield lambda **options: p.chromium.launch_persistent_context(
            tmp_path_factory.mktemp("profile"), executable_path=chromium(), headless=True, args=ARGUMENTS, **options
        )


@pytest.fixture(scope="module")
def visit(browser: Any, address: str) -> Iterator[Visit]:
    context = browser(viewport={"width": 1280, "height": 900}, color_scheme="light")
    found = Visit(context.pages[0])
    found.page.goto(address)
    found.page.wait_for_selector("html[data-ready]", state="attached", timeout=90_000)
    yield found
    context.close()


def test_every_chart_is_drawn(visit: Visit) -> None:
    places, drawn = visit.page.evaluate(
        "() => [document.querySelectorAll('.plot').length, document.querySelectorAll('.plot .main-svg').length]"
    )
    assert places > 15
    assert drawn >= places
    empty = visit.page.evaluate(
        "() => [...document.querySelectorAll('.plot')].filter(e => !e.querySelector("
        "'.scatterlayer path, .barlayer path, .contourlayer path, .heatmaplayer image')).map(e => e.id)"
    )
    assert empty == []


def test_no_button_offers_to_send_a_chart_anywhere(visit: Visit) -> None:
    """plotly.js has a button that uploads a chart to its makers' cloud, on by default."""
    titles = visit.page.eval_on_selector_all(".modebar-btn", "b => [...new Set(b.map(e => e.dataset.title))]")
    assert set(titles) == {"Download plot", "Zoom", "Pan", "Zoom in", "Zoom out", "Reset axes"}


def test_a_plot_is_one_stop_of_the_tab_key_and_the_arrows_reach_its_tools(visit: Visit) -> None:
    """Six buttons beside each plot were six stops more: 250 to get past the figures."""
    page = visit.page
    stops = page.eval_on_selector_all(
        ".plot.js-plotly-plot", "p => p.map(e => [e, ...e.querySelectorAll('*')].filter(c => c.tabIndex >= 0).length)"
    )
    assert set(stops) == {1}
    plot = page.locator(".plot[data-figure=convergence]")
    plot.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    second = plot.locator(".modebar-btn").nth(1).get_attribute("data-title")
    focused = "() => [document.activeElement.dataset.title, document.activeElement.dataset.figure]"
    assert page.evaluate(focused) == [second, None]
    page.keyboard.press("Escape")
    assert page.evaluate(focused) == [None, "convergence"]
    page.keyboard.press("Tab")
    assert page.evaluate("() => document.activeElement.closest('[data-figure=convergence]') === null")


def test_table_sorts_by_mouse_and_by_keyboard(visit: Visit) -> None:
    page = visit.page
    first = "() => [...document.querySelectorAll('#table tbody tr')].map(r => Number(r.dataset.candidate))"
    head = page.locator("#table thead button", has_text="Candidate")
    head.click()
    assert page.evaluate(first) == sorted(page.evaluate(first))
    head.focus()
    page.keyboard.press("Enter")
    assert page.evaluate(first) == sorted(page.evaluate(first), reverse=True)
    assert head.locator("xpath=..").get_attribute("aria-sort") == "descending"


def test_the_table_is_narrowed_down_by_words_and_by_the_share_left_open(visit: Visit) -> None:
    page = visit.page
    rows = "[...document.querySelectorAll('#table tbody tr')].filter(r => !r.hidden)"
    shown = f"() => {rows}.map(r => Number(r.dataset.candidate))"
    records = open_campaign(hostile_store()).records()
    page.fill("#filter", "trust-region")
    expected = [i for i, origin in enumerate(records["origin"]) if str(origin) == "trust-region"]
    assert sorted(page.evaluate(shown)) == expected != []
    page.fill("#filter", "")
    half = float(np.nanmedian(records["p_nc"]))
    most = round(100.0 * half + 0.05, 2)
    page.fill("#most-open", repr(most))
    assert sorted(page.evaluate(shown)) == np.flatnonzero(100.0 * records["p_nc"] <= most).tolist()
    assert f"of {len(records['p_nc'])} rows" in page.inner_text("#filtered")
    page.fill("#most-open", "")
    assert len(page.evaluate(shown)) == len(records["p_nc"])


def test_picking_a_candidate_shows_its_waveform_and_metrics(visit: Visit) -> None:
    page = visit.page
    before = page.locator("#pulses").inner_text(), page.locator("#metrics").inner_text()
    line = "() => document.querySelector('#fig-response .scatterlayer path.js-line').getAttribute('d')"
    drawn = page.evaluate(line)
    best = page.locator("#pick").input_value()
    other = next(
        v for v in page.eval_on_selector_all("#place option", "o => o.map(e => e.value)") if v not in ("", best)
    )
    page.locator(f'#table button[data-show="{other}"]').click()
    assert page.locator("#pick").input_value() == other
    assert page.locator("#pulses").inner_text() != before[0]
    assert page.locator("#metrics").inner_text() != before[1]
    assert page.evaluate(line) != drawn
    page.locator("#pick-best").click()
    assert page.locator("#pick").input_value() == best


def test_every_candidate_can_be_opened_by_its_number_and_shows_the_waveform_that_is_stored(visit: Visit) -> None:
    page = visit.page
    campaign = open_campaign(hostile_store())
    usable = np.flatnonzero(np.isfinite(campaign.records()["g_cm_s"]))
    assert len(usable) > 5
    for i in usable.tolist():
        page.locator("#pick").fill(str(i))
        page.locator("#pick").press("Enter")
        x, y = page.evaluate("() => { const d = document.getElementById('fig-response').data[0]; return [d.x, d.y]; }")
        expected = Waveform.from_rows(campaign.waveform(i)).voltage(np.array(x))
        np.testing.assert_allclose(y, expected, atol=0.05)
        assert max(y) == pytest.approx(Waveform.from_rows(campaign.waveform(i)).max_voltage(250.0), abs=0.2)
    page.locator("#pick").fill("999")
    page.locator("#pick").press("Enter")
    assert "does not hold it" in page.locator("#pick-said").inner_text()
    page.locator("#pick-best").click()


def test_page_follows_the_theme_and_fits_a_telephone_while_it_is_open(visit: Visit) -> None:
    page = visit.page
    paper = "() => getComputedStyle(document.body).backgroundColor"
    ink = "() => document.querySelector('#fig-convergence text').style.fill"
    assert (page.evaluate(paper), page.evaluate(ink)) == ("rgb(255, 255, 255)", "rgb(27, 31, 36)")
    page.emulate_media(color_scheme="dark")
    visit.until(f"() => ({ink})() === 'rgb(232, 236, 240)'")
    assert page.evaluate(paper) == "rgb(18, 22, 27)"
    page.set_viewport_size({"width": 390, "height": 800})
    visit.until("() => [...document.querySelectorAll('.main-svg')].every(s => s.clientWidth <= 390)")
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 390
    page.set_viewport_size({"width": 1280, "height": 900})
    visit.until("() => document.querySelector('#fig-response .main-svg').clientWidth > 900")


def test_print_holds_every_chart_in_the_light_theme_on_paper_s_width(visit: Visit) -> None:
    page = visit.page
    page.emulate_media(color_scheme="dark")
    page.evaluate("() => dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate("() => [...document.querySelectorAll('.plot .main-svg')].every(s => s.clientWidth <= 700)")
    assert page.evaluate("() => document.querySelector('#fig-convergence text').style.fill") == "rgb(27, 31, 36)"
    assert page.evaluate("() => document.querySelector('details').open")
    page.emulate_media(media="print")
    cut = (
        "() => [...document.querySelectorAll('.wide')].filter(e => e.scrollWidth > e.clientWidth).map(e => e.ariaLabel)"
    )
    assert page.evaluate(cut) == []
    hints = "() => [...document.querySelectorAll('figcaption .screen')].map(e => getComputedStyle(e).display)"
    assert set(page.evaluate(hints)) == {"none"}
    page.emulate_media(media="screen")
    page.evaluate("() => dispatchEvent(new Event('afterprint'))")
    page.emulate_media(color_scheme="light")
    assert not page.evaluate("() => document.querySelector('details').open")


def test_a_click_in_the_convergence_shows_the_candidate(visit: Visit) -> None:
    page = visit.page
    worst = page.locator("#table tbody tr button.show").last.get_attribute("data-show")
    page.evaluate(
        f"() => document.getElementById('fig-convergence').emit('plotly_click', {{points: [{{x: {worst}}}]}})"
    )
    assert page.locator("#pick").input_value() == worst
    page.locator("#pick-best").click()


def test_nothing_is_said_on_the_console_and_nothing_is_asked_of_a_network(visit: Visit, address: str) -> None:
    """Last, so that all of the above is covered."""
    assert visit.said == []
    assert visit.requests == [address]
