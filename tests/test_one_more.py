"""What one more of a kind costs: each is added once, here, and every analysis knows it (docs/explanation/rooms.md)."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, Self

import numpy as np
import pytest
from pydantic import BaseModel, Field
from scipy.special import ndtri

from conditions_of_campaigns import DRIVE
from small_campaigns import COARSE, make_campaign
from softclose import Pulse, Waveform, plugins, simulate
from softclose.conditions.protocol import Condition, Coordinate, Surroundings, Uniforms
from softclose.conditions.streams import Stream
from softclose.device.drives import Drives, product
from softclose.evaluate import chain, coordinates, draw, evaluate, respond
from softclose.evaluate.asked import told
from softclose.evaluate.quantities import QUANTITIES, Closing, Quantity, quantity
from softclose.evaluate.realise import column_names
from softclose.population.lot import COLUMNS, Column, Lot
from softclose.settings import CampaignConfig, ConfigError, load_config
from softclose.uncertainty.sensitivity import sensitivity
from softclose.uncertainty.tails import tail
from softclose_store import open_campaign
from softclose_workflows.report import sections
from softclose_workflows.report.gather import gather
from softclose_workflows.report.page import render_report
from softclose_workflows.tell.assumptions import assumptions

CONFIG = load_config({})


@dataclass(frozen=True, slots=True)
class Ageing(Condition):
    """A condition that nobody has: springs that have lost some stiffness, and drives that were turned down for it."""

    section: ClassVar[str] = "campaign"
    columns: ClassVar[tuple[str, ...]] = ("age",)  # type: ignore[misc]
    around: Surroundings

    @classmethod
    def of(cls, settings: Any, around: Surroundings) -> Self:
        return cls(around)

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:  # type: ignore[override]
        return (Coordinate(name="age", stream=Stream.TIMING, parts=("age",)),)

    @classmethod
    def assumed(cls, settings: Any) -> list[str]:
        return [f"Springs of {settings.name} have aged."]

    def lot(self, lot: Lot, u: Uniforms) -> Lot:
        loss = 0.1 * np.abs(ndtri(np.clip(u["age"][:, 0], 1e-9, 1 - 1e-9)))
        return lot.with_columns(K=lot["K"] * (1.0 - np.minimum(loss, 0.5)), age=loss)

    def drives(self, drives: Drives, lot: Lot) -> Drives:
        return replace(drives, volts=product(drives.volts, 1.0 - 0.1 * lot["age"]))


@pytest.fixture
def aged(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(COLUMNS, "age", Column("age", "1", "stiffness that a spring has lost"))
    monkeypatch.setattr(chain, "CONDITIONS", (*chain.CONDITIONS, Ageing))
    chain._chain.cache_clear()
    yield
    chain._chain.cache_clear()


@pytest.mark.usefixtures("aged")
def test_one_more_condition_is_known_to_every_analysis_that_draws_or_simulates() -> None:
    """A file of its own, its column, its place in the chain (and its section of the configuration)."""
    config = replace(CONFIG)
    lot = draw(config, 200, seed=1)
    assert tuple(lot) == column_names(config)
    plain = CONFIG.build_population().sample(200, seed=1)
    assert (lot["K"] < plain[:, 2]).all()
    found = respond(config, lot, DRIVE)
    i = 7
    turned_down = Waveform([replace(p, volts=p.volts * (1.0 - 0.1 * lot["age"][i])) for p in DRIVE.pulses])
    alone = simulate(lot.switches[i : i + 1], turned_down)
    assert found.max_contact_speed[i] == pytest.approx(alone.max_contact_speed[0], rel=1e-5)
    assert [part for c in coordinates(config) for part in c.parts] == ["D", "G", "E", "T", "age"]
    shares = sensitivity(config.build_population(), DRIVE, n=32, n_replicates=2, config=config)
    assert [x.variable for x in shares.indices][4] == "age"
    (rare,) = tail(config, DRIVE, "fast", limit_cm_s=20.0, methods=["brute"], n_switches=500)
    aged_lot = draw(config, 500, seed=0, ensemble=2)
    fast = np.nan_to_num(respond(config, aged_lot, DRIVE).max_contact_speed) > 0.2
    assert rare.probability == fast.mean()
    assert f"Springs of {config.campaign.name} have aged." in assumptions(config)


def test_one_more_drive_error_is_a_column_that_a_condition_reads() -> None:
    """Errors of gain and clock come with the lot: an analysis that brings its own needs no other way."""
    lot = draw(CONFIG, 50, seed=1)
    high = respond(CONFIG, lot.with_columns(gain=np.full(50, 1.05)), DRIVE)
    louder = Waveform([replace(p, volts=1.05 * p.volts) for p in DRIVE.pulses])
    alone = respond(CONFIG, lot, louder)
    np.testing.assert_allclose(high.max_contact_speed, alone.max_contact_speed, atol=1e-7)


def test_one_more_quantity_is_an_object_in_one_file(monkeypatch: pytest.MonkeyPatch) -> None:
    heaviest = Quantity(
        name="momentum", unit="nN s", long_name="momentum at the hardest impact", per="switch",
        values=lambda c: c.lot["M"] * c.response.max_contact_speed,
    )  # fmt: skip
    monkeypatch.setitem(QUANTITIES, heaviest.name, heaviest)
    lot = draw(CONFIG, 100, seed=1)
    closing = Closing.of(CONFIG, lot, DRIVE, respond(CONFIG, lot, DRIVE, max_impacts=100))
    values = np.sort(lot["M"] * closing.response.max_contact_speed)
    values = values[~np.isnan(values)]
    assert quantity("momentum").of(closing).estimate == values[int(np.ceil(0.9 * values.size)) - 1]


def test_one_more_axis_term_limit_and_line_are_a_quantity(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing but the object: it is weighed, limited, told, and an axis of a front."""
    heaviest = Quantity(
        name="momentum", unit="nN s", long_name="momentum at the hardest impact", per="switch",
        values=lambda c: c.lot["M"] * c.response.max_contact_speed,
    )  # fmt: skip
    monkeypatch.setitem(QUANTITIES, heaviest.name, heaviest)
    lot = draw(CONFIG, 100, seed=1)
    plain = evaluate(CONFIG, lot, DRIVE)
    speed = respond(CONFIG, lot, DRIVE).max_contact_speed
    hard = np.sort((lot["M"] * speed)[~np.isnan(speed)])
    expected = hard[int(np.ceil(0.9 * hard.size)) - 1]
    weighed = load_config({"objective": {"weights": {"momentum": 2.0}}})
    assert evaluate(weighed, lot, DRIVE).g_cm_s == pytest.approx(plain.g_cm_s + 2.0 * expected)
    limited = load_config({"objective": {"quantity_limits": {"momentum": expected / 2.0}, "limit_penalty_cm_s": 10.0}})
    assert evaluate(limited, lot, DRIVE).g_cm_s == pytest.approx(plain.g_cm_s + 10.0)
    front = load_config({"optimiser": {"objectives": ["v_u", "momentum"]}, "objective": {"lines": ["momentum"]}})
    response = respond(front, lot, DRIVE)
    assert told(front, response, evaluate(front, lot, DRIVE))["momentum"].estimate == expected


SECTION = '''
from softclose_workflows.report.charts import axis, layout
from softclose_workflows.report.section import Section

class Heaviest(Section):
    name, place = "heaviest", 25
    html = """<p>The heaviest switch weighs {{ "%.6f"|format(found) }} µg, says {{ whose }}.</p>
      {{ figure(figures, "heaviest", "All of them.") }}"""

    def find(self, given):
        return float(given.lot["M"].max())

    def headings(self, found):
        return "Mass & weight", "Mass"

    def figures(self, found, data):
        chart = {"y": [found], "x": [0.0]}
        return {"heaviest": {"data": [chart], "layout": layout(axis("x"), axis("M"), height=99), "alt": "mass"}}

    def told(self, found, data):
        return {"whose": "<b>nobody</b>"}
'''


def test_one_more_report_section_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file in `report/sections`: found, drawn, in the list and in its place; strangers' text stays text."""
    path = str(make_campaign(tmp_path / "a.zarr", *COARSE, "trim.measured=pull-in", "model.quality_factor=5"))
    before = render_report(gather(path, learned=False, picks=False))
    (tmp_path / "rooms").mkdir()
    (tmp_path / "rooms" / "heaviest.py").write_text(SECTION)
    monkeypatch.setattr(sections, "__path__", [*sections.__path__, str(tmp_path / "rooms")])
    try:
        data = gather(path, learned=False, picks=False)
        page = render_report(data)
    finally:
        sys.modules.pop(f"{sections.__name__}.heaviest", None)
    assert list(data.sections) == ["trim", "heaviest", "plainer"]
    heaviest = Lot(open_campaign(path).population())["M"].max()
    assert f"weighs {heaviest:.6f} µg, says &lt;b&gt;nobody&lt;/b&gt;." in page
    assert '<li><a href="#heaviest">Mass</a></li>' in page
    assert '<h2 id="h-heaviest">Mass &amp; weight</h2>' in page
    assert 'data-figure="heaviest"' in page
    assert page.index('id="trim"') < page.index('id="heaviest"') < page.index('id="plainer"')
    assert "heaviest" not in before


def test_one_more_device_model_touches_no_file(monkeypatch: pytest.MonkeyPatch) -> None:
    def heavier(switches: Any, *arguments: Any, **settings: Any) -> Any:
        return simulate(np.asarray(switches) * [1.0, 1.0, 1.0, 1.1], *arguments, **settings)

    entry = SimpleNamespace(name="heavier", load=lambda: heavier)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry] if group == "softclose.models" else [])
    config = load_config(
        {"model": {"name": "heavier"}, "trim": {"measured": "pull-in"}, "amplifier": {"gain_error": 0.02}}
    )
    lot = draw(config, 20, seed=1)
    assert evaluate(config, lot, DRIVE).n_failed == 0
    i = 3
    a, b = lot["voltage_scale"][i] * lot["gain"][i], lot["time_scale"][i]
    drive = Waveform([Pulse(p.start_us * b, p.rise_us * b, p.peak_us * b, p.volts * a) for p in DRIVE.pulses])
    alone = heavier(lot.switches[i : i + 1], drive, horizon_us=250.0 * b, max_volts=1e9)
    assert respond(config, lot, DRIVE).max_contact_speed[i] == pytest.approx(alone.max_contact_speed[0], rel=1e-6)


class Server(BaseModel):
    """Settings that a device model has of its own."""

    excess: float = Field(default=1.0, gt=0, le=10)
    names: list[str] = []


def served(switches: Any, *arguments: Any, options: Server, **settings: Any) -> Any:
    return simulate(np.asarray(switches) * [1.0, 1.0, 1.0, options.excess], *arguments, **settings)


served.Options = Server  # type: ignore[attr-defined]


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = SimpleNamespace(name="served", load=lambda: served)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry] if group == "softclose.models" else [])


@pytest.mark.usefixtures("server")
def test_a_device_model_checks_settings_of_its_own() -> None:
    config = load_config({"model": {"name": "served"}}, ["model.options.excess=1.2"])
    assert config.model.options == {"excess": 1.2, "names": []}  # written out, so part of the identity
    assert config.fingerprint() != load_config({"model": {"name": "served"}}).fingerprint()
    assert CampaignConfig.from_dict(config.to_dict()) == config
    lot = draw(config, 20, seed=1)
    expected = simulate(lot.switches * [1.0, 1.0, 1.0, 1.2], DRIVE)
    np.testing.assert_array_equal(respond(config, lot, DRIVE).max_contact_speed, expected.max_contact_speed)
    plain = respond(load_config({"model": {"name": "served"}}), lot, DRIVE)
    np.testing.assert_array_equal(plain.max_contact_speed, simulate(lot.switches, DRIVE).max_contact_speed)


@pytest.mark.usefixtures("server")
@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"excess": -1}, "model.options.excess is -1: Input should be greater than 0"),
        ({"excess": "much"}, "model.options.excess is 'much': Input should be a valid number"),
        ({"exces": 1.0}, "model.options.exces is no option of model 'served'; did you mean 'excess'"),
        ({"names": [1, 2]}, "model.options.names.0 is 1: .*; model.options.names.1 is 2: "),
    ],
)
def test_options_that_a_model_does_not_allow_are_refused_in_its_words(options: Any, said: str) -> None:
    with pytest.raises(ConfigError, match=said) as told:
        load_config({"model": {"name": "served", "options": options}})
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("name", ["single-mode", "measured"])
def test_a_model_without_options_takes_none(name: str) -> None:
    with pytest.raises(ConfigError, match=r"takes its settings from .model. itself: leave the table out"):
        load_config({"model": {"name": name, "options": {"excess": 1.0}}})


def test_a_model_whose_options_are_no_pydantic_model_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = SimpleNamespace(name="odd", load=lambda: SimpleNamespace(Options={"a": 1}))
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry] if group == "softclose.models" else [])
    with pytest.raises(ConfigError, match=r"Options of model 'odd' is .*; it must be a pydantic model"):
        load_config({"model": {"name": "odd"}})


def test_a_deeper_override_makes_the_tables_on_its_way() -> None:
    with pytest.raises(ConfigError, match=r"campaign.seed is 3; it must be a table of keys"):
        load_config({"campaign": {"seed": 3}}, ["campaign.seed.x=1"])
