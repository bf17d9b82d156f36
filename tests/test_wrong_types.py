"""Claims about Python: a value of a wrong type gets one of our errors, which says what was got and what to give."""

from __future__ import annotations

import numpy as np
import pytest

import softclose
import softclose_store
from softclose.metrics.objective import ObjectiveError
from softclose.population import PopulationError
from softclose.population.measurements import MeasurementError
from softclose_workflows import api

HOLD = softclose.Waveform.from_rows([(0.0, 4.0, None, 100.0)])
POPULATION = softclose.load_population("current")
SWITCHES = POPULATION.sample(5, seed=1)
RESPONSES = softclose.simulate(SWITCHES, HOLD)
CONFIG = softclose.load_config("current")
CUBE = np.full((2, 4), 3.0)

WRONG = {
    "pulse of text": lambda: softclose.Pulse(start_us="a", rise_us=4.0, peak_us=4.0, volts=1.0),
    "waveform of a number": lambda: softclose.Waveform(3),
    "waveform of numbers": lambda: softclose.Waveform([1, 2]),
    "rows of text": lambda: softclose.Waveform.from_rows("abc"),
    "rows of none": lambda: softclose.Waveform.from_rows(None),
    "rows of numbers": lambda: softclose.Waveform.from_rows([1.0, 2.0]),
    "instant of text": lambda: HOLD.voltage("a"),
    "instant of none": lambda: HOLD.voltage(None),
    "horizon of text": lambda: HOLD.max_voltage("a"),
    "limit of text": lambda: HOLD.check("a"),
    "population of a number": lambda: softclose.load_population(3),
    "sample of a fraction": lambda: POPULATION.sample(3.5, seed=1),
    "seed of text": lambda: POPULATION.sample(3, seed="x"),
    "probabilities of a list": lambda: POPULATION.quantile([0.5]),
    "probabilities of text": lambda: POPULATION.quantile("a"),
    "probabilities above one": lambda: POPULATION.quantile(CUBE),
    "switches of text": lambda: softclose.simulate("a", HOLD),
    "switches of complex numbers": lambda: softclose.simulate(SWITCHES + 1j, HOLD),
    "waveform of text": lambda: softclose.simulate(SWITCHES, "w"),
    "threads of a fraction": lambda: softclose.simulate(SWITCHES, HOLD, threads=1.5),
    "times of text": lambda: softclose.simulate(SWITCHES, HOLD, times_us="a"),
    "tolerance of none": lambda: softclose.simulate(SWITCHES, HOLD, rtol=None),
    "response of text": lambda: softclose.assess("a"),
    "response of none": lambda: softclose.assess(None),
    "limits of a number": lambda: softclose.assess(RESPONSES, limits_cm_s=19.7),
    "configuration of a number": lambda: softclose.load_config(3),
    "override of a number": lambda: softclose.load_config("current", [3]),
    "overrides of a number": lambda: softclose.load_config("current", 3),
    "overrides of text": lambda: softclose.load_config("current", "seed 3"),
    "extension of text": lambda: CONFIG.extended("a"),
    "candidates of text": lambda: CONFIG.retried("a"),
    "revision of a number": lambda: CONFIG.revised(3),
    "sections of a number": lambda: softclose.CampaignConfig.from_dict(3),
    "description of a number": lambda: softclose.Population.from_dict(3),
    "store of a number": lambda: softclose_store.open_campaign(3),
    "verified number": lambda: softclose_store.verify(3),
    "groups of a number": lambda: softclose_store.list_groups(3),
    "group of a number": lambda: softclose_store.read_group("none.zarr", 3),
    "lock of a number": lambda: softclose_store.lock_holder(3),
    "run of a number": lambda: api.run(3, "none.zarr"),
    "run into a number": lambda: api.run("current", 3),
    "workers of text": lambda: api.run("current", "none.zarr", workers="a"),
    "settings of a number": lambda: api.run("current", "none.zarr", settings=3),
    "resumed number": lambda: api.resume(3),
    "certified number": lambda: api.certify(3),
    "report of none": lambda: api.report(None),
    "measurements of a number": lambda: api.calibrate(3),
    "opened none": lambda: api.open_run(None),
}


@pytest.mark.parametrize("call", [pytest.param(call, id=name.replace(" ", "-")) for name, call in WRONG.items()])
def test_a_wrong_type_gets_an_error_of_our_own(call):
    with pytest.raises(Exception) as caught:  # noqa: PT011 - which of ours is for the next test
        call()
    assert type(caught.value).__module__.startswith("softclose")
    assert len(str(caught.value)) > 20


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (lambda: softclose.load_population(3), PopulationError, r"3 is no population; give the path .* current"),
        (lambda: softclose.load_config(3), softclose.settings.ConfigError, r"3 is no preset or file; give .* current"),
        (lambda: softclose.assess(None), ObjectiveError, "None is no response; give what simulate returns"),
        (lambda: softclose_store.verify(3), softclose_store.StoreError, "3 is no store; give the path of a directory"),
        (lambda: api.calibrate(3), MeasurementError, "3 is no file of measurements; give the path of a CSV"),
        (lambda: CONFIG.extended(9.5), softclose.settings.ConfigError, "9.5 is no number of candidates; give a whole"),
    ],
)
def test_it_says_what_was_got_and_what_to_give(call, error, said):
    with pytest.raises(error, match=said):
        call()
