"""Claims about device models: another one is named by the configuration and used by the whole campaign."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from softclose import plugins, simulate
from softclose.device import protocol
from softclose.device.simulate import Responses
from softclose.settings import ConfigError, load_config


def heavier(switches: Any, *arguments: Any, **settings: Any) -> Responses:
    """A device whose plate carries a tenth more mass."""
    return simulate(np.asarray(switches) * [1.0, 1.0, 1.0, 1.1], *arguments, **settings)


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = SimpleNamespace(name="heavier", load=lambda: heavier)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry] if group == "softclose.models" else [])


def test_the_model_of_the_study_is_the_default() -> None:
    assert load_config({}).model.name == plugins.SINGLE_MODE
    assert protocol.load_model(plugins.SINGLE_MODE) is simulate


def test_for_what_is_shipped_nobody_looks_through_the_installed_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes 30 ms, and a configuration is read by every command."""

    def looked(group: str) -> list[Any]:
        raise AssertionError(f"looked for {group}")

    monkeypatch.setattr(plugins, "entry_points", looked)
    assert load_config("current").model.name == plugins.SINGLE_MODE
    with pytest.raises(AssertionError, match="models"):
        plugins.MODELS.check("heavier")


@pytest.mark.usefixtures("installed")
def test_an_installed_model_is_named_in_the_configuration_and_loaded() -> None:
    assert load_config({}, ["model.name=heavier"]).model.name == "heavier"
    assert protocol.load_model("heavier").__wrapped__ is heavier  # type: ignore[attr-defined]


def test_a_model_that_is_not_installed_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(ConfigError, match="no device model named 'single-mod'; did you mean 'single-mode'"):
        load_config({}, ["model.name=single-mod"])
