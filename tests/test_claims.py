"""Claims about what README and pages say of shares and figures: each is what presets and measured tables say."""

from __future__ import annotations

import json
import re
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from softclose.baselines import unshaped
from softclose.evaluate import draw, respond
from softclose.presets import preset_names
from softclose.settings import CampaignConfig, load_config

ROOT = Path(__file__).parents[1]
WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


preset = cache(load_config)
"""A preset that ships. Reading it may simulate: none is read as tests are collected, and each once a process."""


def presets() -> dict[str, CampaignConfig]:
    """Every preset that ships."""
    return {name: preset(name) for name in preset_names()}


def page(name: str) -> str:
    """A page's text with its lines joined."""
    return " ".join((ROOT / name).read_text("utf-8").split())


def said(sentence: str, name: str) -> None:
    """The page has the sentence; if it does not, this is what it should say."""
    assert sentence in page(name), f"{name} should say: {sentence}"


def spelt(n: int) -> str:
    """A count as prose has it."""
    return WORDS[n] if n < len(WORDS) else str(n)


PROCESS = {"skopt": "a Gaussian process", "parego": "a Gaussian process, for a front"}
"""Engines that are led by one."""


def searched_by(config: CampaignConfig) -> str:
    """Which engines propose."""
    if config.explore.budget and not config.campaign.budget:
        return "descents"
    return PROCESS.get(config.optimiser.engine, "a published procedure")


def test_how_many_presets_search_by_what() -> None:
    n = Counter(map(searched_by, presets().values()))
    process = sum(n[kind] for kind in PROCESS.values())
    alone = f", {spelt(n['descents'])} by descents alone" if n["descents"] else ""
    said(
        f"Of the {len(presets())} presets that ship, {spelt(process)} search by the Gaussian process, "
        f"{spelt(n[PROCESS['parego']])} of them for a front{alone}, and {spelt(n['a published procedure'])} by a "
        "published procedure.",
        "docs/explanation/search.md",
    )
    published = {c.optimiser.engine for c in presets().values() if searched_by(c) == "a published procedure"}
    assert published == {"paper", "direct"}


@pytest.mark.parametrize("name", ["README.md", "docs/index.md"])
def test_the_front_pages_name_both_kinds_of_search(name: str) -> None:
    said("lets a Gaussian process or independent descents propose the next candidates", name)


def test_whose_training_intervals_hold() -> None:
    n = Counter(c.population.sampling for c in presets().values())
    assert set(n) == {"replicated", "monte-carlo"}, "one Sobol sample has no intervals"
    published = {name for name, c in presets().items() if searched_by(c) == "a published procedure"}
    assert published == {name for name, c in presets().items() if c.population.sampling == "monte-carlo"}
    said(
        f"Of the {len(presets())} presets {spelt(n['replicated'])} train so; the {spelt(n['monte-carlo'])} published "
        'procedures use independent draws (`"monte-carlo"`).',
        "docs/explanation/statistics.md",
    )


@pytest.mark.parametrize("name", preset_names())
def test_every_impact_and_a_whole_motion_is_kept_of_every_switch(name: str) -> None:
    """README: every trajectory, impact and objective. Nothing bounces more often than under a step."""
    config = preset(name)
    said("keeps every trajectory, impact and objective in a Zarr store", "README.md")
    lot = draw(config, 64, seed=1)
    found = respond(config, lot, unshaped(config.waveform.max_volts), max_impacts=1)
    assert found.n_impacts.max() <= config.store.max_impacts
    assert config.model.horizon_us / (config.store.n_times - 1) <= 2.5, "no sample is later than 2.5 µs"


CASES: list[dict[str, Any]] = json.loads((ROOT / "docs" / "results" / "table.json").read_text("utf-8"))["cases"]


def case(title: str, how: str = "") -> dict[str, Any]:
    """The case of a title, and of how it was searched."""
    (found,) = [c for c in CASES if c["title"] == title and (not how or c["store"].endswith(how))]
    return found


def test_the_readme_says_how_long_the_tests_take() -> None:
    """To a quarter, of what docs/measurements/tests.md has of the newest run."""
    table = (ROOT / "docs" / "measurements" / "tests.md").read_text("utf-8")
    rows = re.findall(r"^\| `(make \w+)` \| ([\d.]+) \|", table, re.MULTILINE)
    measured = {name: float(minutes) for name, minutes in reversed(rows)}
    assert "make test" in measured
    for name, minutes in measured.items():
        found = re.search(rf"`{name}` tries[^.;]*? some (\d+) minutes on two", page("README.md"))
        assert found is not None, f"README.md should say how long `{name}` takes: some N minutes on two"
        assert int(found[1]) == pytest.approx(minutes, rel=0.25), (name, found[1], minutes)


def test_what_the_study_s_page_says_is_in_its_table() -> None:
    """Figures in sentences of docs/results/README.md, from table.json."""
    v = {
        (title, store): case(title, store)
        for title, store in (
            ("unshaped 100 V", ""),
            ("deterministic design", ""),
            ("current design, 2 pulses", "current-two.zarr"),
            ("current design, 2 pulses", "current-paper.zarr"),
            ("current design, 3 pulses", "current-three.zarr"),
            ("current design, 3 pulses", "current-direct.zarr"),
            ("modified design, 2 pulses", "modified.zarr"),
            ("modified design, 2 pulses", "modified-paper.zarr"),
            ("modified design, 3 pulses", ""),
            ("improved process, 2 pulses", "process-improved.zarr"),
            ("improved process, 2 pulses", "process-improved-paper.zarr"),
            ("improved process, 3 pulses", ""),
            ("unshaped 100 V, literal ±25 %", ""),
            ("current design, literal ±25 %, 2 pulses", ""),
        )
    }
    step, mean, two, paper, three, direct, m2, mp, m3, i2, ip, i3, lit, litbest = v.values()
    u = {id(c): f"{c['v_u_cm_s']:.1f}" for c in v.values()}
    for sentence in (
        f"v_u ({u[id(step)]} against 40.7) and mean V ({step['mean_cm_s']:.1f} against 34.1)",
        f"current {u[id(paper)]} (",
        f"modified {u[id(mp)]} against 12.5, improved process {u[id(ip)]} against 12.8 cm/s",
        f"v_u {u[id(mean)]} against 42.6, mean V {mean['mean_cm_s']:.1f} against 24.7",
        f"ends at {direct['v_u_cm_s']:.2f} with {100 * direct['p_nc']:.1f} % left open (g {direct['g_cm_s']:.1f}",
        f"finds {u[id(three)]} with {100 * three['p_nc']:.1f} % left open (g {three['g_cm_s']:.1f}",
        f"({u[id(m3)]} against {u[id(m2)]})",
        f"({u[id(i3)]} against {u[id(i2)]})",
        f"{u[id(two)]} instead of 19.7 (current), {u[id(m2)]} instead of 12.5 (modified), {u[id(i2)]} instead of 12.8",
        f"from {paper['g_cm_s']:.1f} to {two['g_cm_s']:.1f}, from {mp['g_cm_s']:.1f} to {m2['g_cm_s']:.1f} and from "
        f"{ip['g_cm_s']:.1f} to {i2['g_cm_s']:.1f}",
        f"gives {u[id(lit)]} for the unshaped step (printed 40.7), and {u[id(litbest)]} for the best waveform",
    ):
        said(sentence, "docs/results/README.md")
