"""Softclose: the science. Simulate ensembles of MEMS switches and assess and propose drive waveforms.

Public names are imported on first use, so that `import softclose` is quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

ALGORITHM = "8"
"""Version of what is proposed and simulated: raised whenever the same configuration would give another store. Part of a
campaign's identity."""

if TYPE_CHECKING:
    from softclose.conditions.temperature import heated as heated
    from softclose.conditions.trim import trim_of as trim_of
    from softclose.device.protocol import CannotSimulate as CannotSimulate
    from softclose.device.protocol import DeviceModel as DeviceModel
    from softclose.device.simulate import Responses as Responses
    from softclose.device.simulate import Status as Status
    from softclose.device.simulate import simulate as simulate
    from softclose.evaluate import draw as draw
    from softclose.evaluate import judge as judge
    from softclose.evaluate import realise as realise
    from softclose.evaluate import respond as respond
    from softclose.evaluate.chain import chain_of as chain_of
    from softclose.evaluate.quantities import Closing as Closing
    from softclose.evaluate.quantities import Quantity as Quantity
    from softclose.evaluate.quantities import quantity as quantity
    from softclose.metrics.objective import Assessment as Assessment
    from softclose.metrics.objective import assess as assess
    from softclose.plugins import EngineError as EngineError
    from softclose.plugins import ModelError as ModelError
    from softclose.plugins import allow_code as allow_code
    from softclose.population import Population as Population
    from softclose.population import load_population as load_population
    from softclose.population.calibrate import calibrate as calibrate
    from softclose.population.lot import Lot as Lot
    from softclose.population.measurements import read_measurements as read_measurements
    from softclose.propose.protocol import Engine as Engine
    from softclose.propose.protocol import Observation as Observation
    from softclose.propose.protocol import Problem as Problem
    from softclose.propose.protocol import Proposal as Proposal
    from softclose.propose.protocol import Wave as Wave
    from softclose.propose.protocol import WaveEngine as WaveEngine
    from softclose.settings import CampaignConfig as CampaignConfig
    from softclose.settings import load_config as load_config
    from softclose.switch.losses import Losses as Losses
    from softclose.switch.reduced_order import ReducedOrder as ReducedOrder
    from softclose.switch.reduced_order import read_reduced_order as read_reduced_order
    from softclose.uncertainty.tolerance import DriveError as DriveError
    from softclose.uncertainty.tolerance import drive_tolerance as drive_tolerance
    from softclose.waveform import Delivered as Delivered
    from softclose.waveform import Pulse as Pulse
    from softclose.waveform import Trace as Trace
    from softclose.waveform import Waveform as Waveform
    from softclose.waveform import read_trace as read_trace

_HOME = {
    "Assessment": "metrics.objective",
    "CampaignConfig": "settings",
    "CannotSimulate": "device.protocol",
    "Wave": "propose.protocol",
    "WaveEngine": "propose.protocol",
    "DeviceModel": "device.protocol",
    "Engine": "propose.protocol",
    "EngineError": "plugins",
    "ModelError": "plugins",
    "Losses": "switch.losses",
    "Observation": "propose.protocol",
    "Population": "population",
    "Problem": "propose.protocol",
    "Proposal": "propose.protocol",
    "Pulse": "waveform",
    "ReducedOrder": "switch.reduced_order",
    "Responses": "device.simulate",
    "Status": "device.simulate",
    "Trace": "waveform",
    "Waveform": "waveform",
    "Lot": "population.lot",
    "draw": "evaluate",
    "judge": "evaluate",
    "realise": "evaluate",
    "respond": "evaluate",
    "read_trace": "waveform",
    "allow_code": "plugins",
    "assess": "metrics.objective",
    "load_config": "settings",
    "load_population": "population",
    "read_reduced_order": "switch.reduced_order",
    "simulate": "device.simulate",
    "Delivered": "waveform",
    "DriveError": "uncertainty.tolerance",
    "drive_tolerance": "uncertainty.tolerance",
    "calibrate": "population.calibrate",
    "read_measurements": "population.measurements",
    "heated": "conditions.temperature",
    "trim_of": "conditions.trim",
    "chain_of": "evaluate.chain",
    "Quantity": "evaluate.quantities",
    "quantity": "evaluate.quantities",
    "Closing": "evaluate.quantities",
}

__all__ = [  # noqa: RUF022 - the order a reader meets them in
    "Pulse",
    "Waveform",
    "Trace",
    "read_trace",
    "Population",
    "load_population",
    "Lot",
    "draw",
    "realise",
    "respond",
    "judge",
    "simulate",
    "Responses",
    "Status",
    "Losses",
    "ReducedOrder",
    "read_reduced_order",
    "assess",
    "Assessment",
    "CampaignConfig",
    "load_config",
    "DeviceModel",
    "Engine",
    "Problem",
    "Proposal",
    "Observation",
    "EngineError",
    "ModelError",
    "CannotSimulate",
    "WaveEngine",
    "Wave",
    "chain_of",
    "trim_of",
    "heated",
    "Delivered",
    "read_measurements",
    "calibrate",
    "DriveError",
    "drive_tolerance",
    "quantity",
    "Quantity",
    "Closing",
    "ALGORITHM",
    "__version__",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"softclose.{_HOME[name]}"), name)
    raise AttributeError(f"module 'softclose' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
