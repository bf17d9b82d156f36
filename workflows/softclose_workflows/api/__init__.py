"""What the commands do, from Python: `from softclose_workflows import api`.

Every function takes a store's path or URL, or what `run` returned, and gives back an object with a short `repr`, a
table in a notebook (`_repr_html_`) and the numbers themselves (`value`, `rows`, `to_frame()`). Names are
imported on first use.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from softclose_workflows.api.bench import Bench as Bench
    from softclose_workflows.api.bench import Suggestion as Suggestion
    from softclose_workflows.api.campaigns import calibrate as calibrate
    from softclose_workflows.api.campaigns import certify as certify
    from softclose_workflows.api.campaigns import open_run as open_run
    from softclose_workflows.api.campaigns import report as report
    from softclose_workflows.api.campaigns import rescore as rescore
    from softclose_workflows.api.campaigns import resume as resume
    from softclose_workflows.api.campaigns import run as run
    from softclose_workflows.api.campaigns import sensitivity as sensitivity
    from softclose_workflows.api.campaigns import tolerance as tolerance
    from softclose_workflows.api.results import CampaignRun as CampaignRun
    from softclose_workflows.api.results import Result as Result

_HOME = {
    "Bench": "bench",
    "CampaignRun": "results",
    "Result": "results",
    "Suggestion": "bench",
    "calibrate": "campaigns",
    "certify": "campaigns",
    "open_run": "campaigns",
    "report": "campaigns",
    "rescore": "campaigns",
    "resume": "campaigns",
    "run": "campaigns",
    "sensitivity": "campaigns",
    "tolerance": "campaigns",
}

__all__ = [  # noqa: RUF022 - the order a reader meets them in
    "run",
    "resume",
    "open_run",
    "certify",
    "rescore",
    "tolerance",
    "sensitivity",
    "calibrate",
    "report",
    "Bench",
    "Suggestion",
    "CampaignRun",
    "Result",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
