"""Claims about device models of the user's: which failure is the waveform's, and what answer is not believed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from softclose import CannotSimulate, Pulse, Responses, Waveform, load_population, simulate
from softclose.device import protocol
from softclose.device.protocol import ModelError, is_own_word, load_model
from softclose.device.simulate import SimulationError
from softclose.waveform import WaveformError

DRIVE = Waveform([Pulse(0.0, 4.0, np.inf, 100.0)])
SWITCHES = load_population("current").sample(6, seed=1)


def _model(monkeypatch: pytest.MonkeyPatch, change: dict[str, Any]) -> Any:
    def mine(switches: Any, waveform: Any, **settings: Any) -> Responses:
        return replace(simulate(switches, waveform, **settings), **change)

    class Installed:
        shipped: dict[str, str] = {}  # noqa: RUF012

        def load(self, name: str) -> Any:
            return mine

    monkeypatch.setattr(protocol, "MODELS", Installed())
    return load_model("mine")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"max_contact_speed": np.full(6, np.nan)}, "switch 0 is closed and gives its contact speed as nan"),
        ({"status": np.full(6, 127)}, "gives the status 127, which stands for a reading that is missing"),
        ({"max_contact_speed": np.array([0.1, 0.1, -0.2, 0.1, 0.1, 0.1])}, "switch 2 is .* speed as -0.2"),
        ({"max_contact_speed": np.array([0.1, np.inf, 0.2, 0.1, 0.1, 0.1])}, "switch 1 .* as inf"),
        ({"max_contact_speed": np.zeros(5)}, r"max_contact_speed of shape \(5,\) for 6 switches"),
        ({"closed": np.zeros((6, 1), dtype=bool)}, r"closed of shape \(6, 1\)"),
    ],
)
def test_an_answer_that_contradicts_itself_is_not_believed(
    change: dict[str, Any], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ModelError, match=said):
        _model(monkeypatch, change)(SWITCHES, DRIVE, horizon_us=60.0)


def test_open_switches_and_failed_ones_have_no_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    gone = {"max_contact_speed": np.full(6, np.nan)}
    for rest in ({"closed": np.zeros(6, dtype=bool)}, {"status": np.ones(6, dtype=np.int8)}):
        found = _model(monkeypatch, gone | rest)(SWITCHES, DRIVE, horizon_us=60.0)
        assert np.isnan(found.max_contact_speed).all()


def test_shipped_models_are_themselves() -> None:
    assert load_model("single-mode") is simulate


@pytest.mark.parametrize(
    ("failure", "own"),
    [
        (CannotSimulate("no contact"), True),
        (ZeroDivisionError(), True),
        (WaveformError("too high"), True),
        (SimulationError("rtol"), True),
        (ModelError("contradicts itself"), True),
        (ValueError("license server not reached"), False),
        (np.linalg.LinAlgError("singular"), False),
        (RuntimeError("killed"), False),
        (ConnectionError("no answer"), False),
        (MemoryError(), False),
    ],
)
def test_only_the_model_s_own_word_is_the_waveform_s_failure(failure: BaseException, own: bool) -> None:
    assert is_own_word(failure) is own
