"""Owns what the commands `run` and `resume` share: a whole run, then its result in print."""

from __future__ import annotations

from softclose.settings import CampaignConfig
from softclose_workflows.analyses.result import print_result
from softclose_workflows.errors import machine_faults
from softclose_workflows.run import driving
from softclose_workflows.run.executors import Placement


def drive(
    path: str,
    placement: Placement,
    *,
    config: CampaignConfig | None = None,
    break_lock: bool = False,
    quiet: bool = False,
) -> None:
    """Run the campaign in the store to its end, as `run.driving.drive`, and print what came out."""
    driving.drive(path, placement, config=config, break_lock=break_lock, quiet=quiet)
    with machine_faults():
        print_result(path)
