"""What the commands do, from Python: `from softclose_workflows import api`.

Every function takes a store's path or URL, or what `run` returned, and gives back an object with a short `repr`, a
table in a notebook (`_repr_html_`), the numbers themselves (`value`, `rows`, `to_frame()`) and, where its command
draws one, the figure (`plot()`). Names are imported on first use.
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
    from softclose_workflows.api.judging import assess as assess
    from softclose_workflows.api.judging import compare as compare
    from softclose_workflows.api.judging import compare_engines as compare_engines
    from softclose_workflows.api.judging import sign as sign
    from softclose_workflows.api.results import CampaignRun as CampaignRun
    from softclose_workflows.api.results import Result as Result
    from softclose_workflows.api.robustness import drift as drift
    from softclose_workflows.api.robustness import propagate as propagate
    from softclose_workflows.api.robustness import tails as tails
    from softclose_workflows.api.series import reproduce as reproduce
    from softclose_workflows.api.series import study as study
    from softclose_workflows.api.showing import export as export
    from softclose_workflows.api.showing import figures as figures
    from softclose_workflows.api.showing import opening as opening
    from softclose_workflows.api.showing import pareto as pareto
    from softclose_workflows.api.showing import serve as serve
    from softclose_workflows.api.stores import init as init
    from softclose_workflows.api.stores import populations as populations
    from softclose_workflows.api.stores import status as status
    from softclose_workflows.api.stores import submit as submit
    from softclose_workflows.api.stores import tls as tls
    from softclose_workflows.api.stores import verify as verify

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
    "sign": "judging",
    "assess": "judging",
    "compare": "judging",
    "compare_engines": "judging",
    "tails": "robustness",
    "drift": "robustness",
    "propagate": "robustness",
    "figures": "showing",
    "export": "showing",
    "pareto": "showing",
    "opening": "showing",
    "serve": "showing",
    "init": "stores",
    "status": "stores",
    "populations": "stores",
    "verify": "stores",
    "submit": "stores",
    "tls": "stores",
    "study": "series",
    "reproduce": "series",
}

__all__ = [  # noqa: RUF022 - the order a reader meets them in, that of `softclose --help`
    "init",
    "populations",
    "calibrate",
    "run",
    "resume",
    "submit",
    "status",
    "open_run",
    "certify",
    "sign",
    "assess",
    "rescore",
    "compare",
    "compare_engines",
    "report",
    "serve",
    "figures",
    "export",
    "pareto",
    "opening",
    "tolerance",
    "sensitivity",
    "tails",
    "drift",
    "propagate",
    "reproduce",
    "study",
    "verify",
    "tls",
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
