"""Owns the command line: the group, what all commands share, and how a user's mistake is told (no traceback)."""

from __future__ import annotations

import sys
from typing import Any

import click

from softclose import __version__
from softclose_workflows.commands import certify, rescore, resume, run, status, study
from softclose_workflows.errors import EXIT_BAD_INPUT, EXIT_STOPPED, Stopped

EPILOG = """\b
Examples:
  softclose run current --store runs/current.zarr
  softclose run mine.toml --store runs/mine.zarr --workers 8 --set campaign.seed=7
  softclose status runs/current.zarr --watch
  softclose resume runs/current.zarr

\b
Exit codes: 0 done; 2 bad input, nothing was changed; 3 stopped before the end,
nothing committed is lost and `softclose resume STORE` continues.
"""


class Group(click.Group):
    """Turns this project's own errors into one message and an exit code."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; a fault of the program itself keeps its traceback."""
        try:
            return super().invoke(ctx)
        except Stopped as e:
            _say(f"stopped: {e}")
            if store := ctx.meta.get("softclose.store"):
                _say(f"nothing committed is lost; continue with: softclose resume {store}")
            ctx.exit(EXIT_STOPPED)
        except ValueError as e:
            if type(e).__module__.partition(".")[0] not in ("softclose", "softclose_store", "softclose_workflows"):
                raise
            _say(str(e))
            ctx.exit(EXIT_BAD_INPUT)


def _say(message: str) -> None:
    click.echo(f"softclose: {message}", err=True)


@click.group(cls=Group, epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="softclose")
def main() -> None:
    """Design the drive-voltage pulses that close a whole production lot of MEMS switches softly."""
    # A pipe closed early (| head) is no fault of ours; numbers print as UTF-8 wherever we are.
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="replace")


for _command in (run.run, resume.resume, status.status, certify.certify, rescore.rescore, study.study):
    main.add_command(_command)
