"""Softclose: the science. Simulate ensembles of MEMS switches and assess and propose drive waveforms.

Public names are imported on first use, so that `import softclose` is quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from softclose.moved import keep_old_addresses

__version__ = "0.1.0"

ALGORITHM = "2"
"""Version of what is proposed and simulated: raised whenever the same configuration would give another store. Part of a
campaign's identity."""

if TYPE_CHECKING:
    from softclose.config import CampaignConfig as CampaignConfig
    from softclose.config import load_config as load_config
    from softclose.ensemble import Responses as Responses
    from softclose.ensemble import simulate as simulate
    from softclose.metrics.objective import Assessment as Assessment
    from softclose.metrics.objective import assess as assess
    from softclose.population import Population as Population
    from softclose.population import load_population as load_population
    from softclose.waveform import Pulse as Pulse
    from softclose.waveform import Waveform as Waveform

_HOME = {
    "Assessment": "metrics.objective",
    "CampaignConfig": "config",
    "Population": "population",
    "Pulse": "waveform",
    "Responses": "ensemble",
    "Waveform": "waveform",
    "assess": "metrics.objective",
    "load_config": "config",
    "load_population": "population",
    "simulate": "ensemble",
}

__all__ = [  # noqa: RUF022 - the order a reader meets them in
    "Pulse",
    "Waveform",
    "Population",
    "load_population",
    "simulate",
    "Responses",
    "assess",
    "Assessment",
    "CampaignConfig",
    "load_config",
    "ALGORITHM",
    "__version__",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"softclose.{_HOME[name]}"), name)
    raise AttributeError(f"module 'softclose' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)


keep_old_addresses()
