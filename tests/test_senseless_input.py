"""Claims about what is typed: whatever stands in a file or an argument is taken, or refused by one message of ours."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Iterator
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from examples import examples
from softclose import Pulse, Waveform, load_population, simulate
from softclose.allowed.tables import checked
from softclose.device.simulate import SimulationError
from softclose.metrics.objective import ObjectiveError, assess
from softclose.population import PopulationError
from softclose.population.described import PopulationFile
from softclose.population.files import SHIPPED, built
from softclose.population.lot import Lot
from softclose.population.population import Population
from softclose.presets import FOLDER
from softclose.settings import ConfigError, load_config
from softclose.switch.reduced_order import ReducedOrder, ReducedOrderError
from softclose.uncertainty.drift import DriftError, drifted
from softclose.uncertainty.tolerance import DriveError, ToleranceError

SENSELESS = st.one_of(
    st.none(), st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(), st.text(max_size=5),
    st.sampled_from([[], {}, [[]], [{}], [1, "a"], {"a": 1}, [True], [0.0] * 3, ["a"], 10**300, -0.0, "nan", {"": {}}]),
)  # fmt: skip
MODES = [tomllib.loads(path.read_text("utf-8")) for path in sorted((FOLDER / "modes").glob("*.toml"))]


def _places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The way to every entry of nested tables and lists."""
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in entries:
        yield (*at, key)
        yield from _places(inner, (*at, key))


def _with(table: dict[str, Any], at: tuple[Any, ...], value: Any) -> dict[str, Any]:
    changed = copy.deepcopy(table)
    inner: Any = changed
    for key in at[:-1]:
        inner = inner[key]
    inner[at[-1]] = value
    return changed


@settings(max_examples=examples(400), suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_a_model_of_modes_is_read_or_refused(data: st.DataObject) -> None:
    table = data.draw(st.sampled_from(MODES))
    at = data.draw(st.sampled_from(list(_places(table))))
    try:
        ReducedOrder.from_dict(_with(table, at, data.draw(SENSELESS)))
    except ReducedOrderError as e:
        assert len(str(e)) < 2000  # noqa: PT017


@settings(max_examples=examples(400), suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_a_population_is_read_or_refused(data: st.DataObject) -> None:
    shipped = resources.files("softclose.population") / "shipped"
    table = tomllib.loads((shipped / f"{data.draw(st.sampled_from(sorted(SHIPPED)))}.toml").read_text("utf-8"))
    table.pop("base", None)
    at = data.draw(st.sampled_from(list(_places(table))))
    try:
        file = checked(PopulationFile, _with(table, at, data.draw(SENSELESS)), PopulationError)
        assert isinstance(built(file, load_population("current")), Population)
    except PopulationError as e:
        assert len(str(e)) < 2000  # noqa: PT017


@pytest.mark.parametrize(
    "table",
    [
        {"campaign": {f"k{i}": 1 for i in range(5000)}},
        {f"k{i}": 1 for i in range(5000)},
        {f"k{i}": {"a": 1} for i in range(5000)},
    ],
)
def test_thousands_of_mistakes_are_twenty_lines(table: dict[str, Any]) -> None:
    with pytest.raises(ConfigError) as e:
        load_config(table)
    lines = str(e.value).splitlines()
    assert len(lines) == 21
    assert lines[-1] == "and 4,980 problems more"


def test_an_opening_that_ends_beyond_all_horizons_is_refused_before_the_search() -> None:
    with pytest.raises(ConfigError, match=r"opening.watch_us .* together they may reach 1e\+06"):
        load_config("current-opening", ["opening.release_us=999900", "opening.watch_us=200"])


DRIVE = Waveform([Pulse(0.0, 4.0, np.inf, 100.0)])
LOT = load_population("current").sample(4, seed=1)


def test_a_masked_switch_is_missing() -> None:
    masked = np.ma.masked_array(LOT, mask=np.zeros(LOT.shape, dtype=bool))
    simulate(masked, DRIVE, horizon_us=30.0)
    masked[1, 0] = np.ma.masked
    with pytest.raises(SimulationError, match="some entries are masked"):
        simulate(masked, DRIVE)


def test_columns_of_a_data_frame_have_names() -> None:
    frame = pd.DataFrame(LOT[:, ::-1], columns=list("MKGD"))
    expected = simulate(LOT, DRIVE, horizon_us=30.0).max_contact_speed
    np.testing.assert_array_equal(simulate(frame, DRIVE, horizon_us=30.0).max_contact_speed, expected)
    frame["T"] = 7.0
    np.testing.assert_array_equal(simulate(frame, DRIVE, horizon_us=30.0).max_contact_speed, expected)
    for names in ("abcd", "DGKE", "DDGK"):
        with pytest.raises(SimulationError, match="no column"):
            simulate(pd.DataFrame(LOT, columns=list(names)), DRIVE)


def test_a_way_of_sampling_is_known() -> None:
    with pytest.raises(ObjectiveError, match="sampling is 'x'; it must be one of monte-carlo, sobol, replicated"):
        assess(simulate(LOT, DRIVE, horizon_us=30.0), sampling="x")


@pytest.mark.parametrize("value", [1e308, 11.0, -1.0, np.nan, np.inf, -np.inf])
def test_a_drift_is_one_of_a_switch(value: float) -> None:
    with pytest.raises(DriftError, match="it must be above -1"):
        drifted(load_config("current"), Lot.of(LOT), "stiffness", value)
    with pytest.raises(DriftError, match="more than the drive"):
        drifted(load_config("current"), Lot.of(LOT), "charge", value if abs(value) > 20.0 or value != value else 1000.0)


@pytest.mark.parametrize("error", [{"gain": 1e20}, {"gain_sd": 1e20}, {"jitter_us": 1e20}, {"gain": np.nan}])
def test_a_generator_s_errors_are_bounded(error: dict[str, float]) -> None:
    with pytest.raises(ToleranceError, match="it must be"):
        DriveError(**error)
