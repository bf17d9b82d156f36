"""Claims about the report in a real browser: headless Chromium, driven through its DevTools protocol."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from reported import chromium, hostile_store
from softclose_workflows.report.gather import gather
from softclose_workflows.report.page import render_report

pytestmark = [
    pytest.mark.skipif(chromium() is None, reason="needs chromium, which is not installed"),
    pytest.mark.timeout(240),
]

ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
             "--disable-component-update", "--disable-sync"]  # fmt: skip


class Visit:
    """One page in one browser, with everything that it said and asked for."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.said: list[str] = []
        self.requests: list[str] = []
        page.on("console", lambda message: self.said.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: self.said.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("report")
    path = folder / "report.html"
    path.write_text(render_report(gather(hostile_store(folder))), encoding="utf-8")
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


def test_picking_a_candidate_shows_its_waveform_and_metrics(visit: Visit) -> None:
    page = visit.page
    before = page.locator("#pulses").inner_text(), page.locator("#metrics").inner_text()
    line = "() => document.querySelector('#fig-response .scatterlayer path.js-line').getAttribute('d')"
    drawn = page.evaluate(line)
    best = page.locator("#pick").input_value()
    other = next(v for v in page.eval_on_selector_all("#pick option", "o => o.map(e => e.value)") if v != best)
    page.locator(f'#table button[data-show="{other}"]').click()
    assert page.locator("#pick").input_value() == other
    assert page.locator("#pulses").inner_text() != before[0]
    assert page.locator("#metrics").inner_text() != before[1]
    assert page.evaluate(line) != drawn
    page.locator("#pick-best").click()
    assert page.locator("#pick").input_value() == best


def test_nothing_is_said_on_the_console_and_nothing_is_asked_of_a_network(visit: Visit, address: str) -> None:
    assert visit.said == []
    assert visit.requests == [address]


@pytest.mark.parametrize(("width", "scheme"), [(390, "light"), (1280, "dark")])
def test_page_fits_a_telephone_and_follows_the_dark_theme(browser: Any, address: str, width: int, scheme: str) -> None:
    context = browser(viewport={"width": width, "height": 800}, color_scheme=scheme)
    found = Visit(context.pages[0])
    found.page.goto(address)
    found.page.wait_for_selector("html[data-ready]", state="attached", timeout=90_000)
    assert found.page.evaluate("() => document.documentElement.scrollWidth") <= width
    paper = found.page.evaluate("() => getComputedStyle(document.body).backgroundColor")
    ink = found.page.evaluate("() => document.querySelector('#fig-convergence text').style.fill")
    assert (paper == "rgb(255, 255, 255)") == (scheme == "light")
    assert (ink == "rgb(27, 31, 36)") == (scheme == "light")
    assert found.said == []
    context.close()


def test_print_holds_every_chart_on_paper_of_any_theme(browser: Any, address: str, tmp_path: Path) -> None:
    context = browser(viewport={"width": 1280, "height": 800}, color_scheme="dark")
    page = context.pages[0]
    page.goto(address)
    page.wait_for_selector("html[data-ready]", state="attached", timeout=90_000)
    page.evaluate("() => dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate("() => [...document.querySelectorAll('.plot .main-svg')].every(s => s.clientWidth <= 700)")
    ink = page.evaluate("() => document.querySelector('#fig-convergence text').style.fill")
    assert ink == "rgb(27, 31, 36)"
    context.close()
