"""Owns the command line: the group, what all commands share, and how a user's mistake is told (no traceback)."""

from __future__ import annotations

import atexit
import functools
import gc
import importlib
import os
import re
import sys
from typing import Any

import click

from softclose import __version__
from softclose_workflows.errors import (
    EXIT_BAD_INPUT,
    EXIT_DAMAGED,
    EXIT_STOPPED,
    Stopped,
    StoreGoneError,
    machine_faults,
)
from softclose_workflows.terminal import say

EPILOG = """\b
Examples:
  softclose run current --store runs/current.zarr
  softclose run mine.toml --store runs/mine.zarr --workers 8 --set campaign.seed=7
  softclose status runs/current.zarr --watch
  softclose resume runs/current.zarr

\b
Exit codes: 0 done; 1 the store is damaged, `softclose verify STORE --repair`;
2 bad input, nothing was changed; 3 stopped before the end, nothing
committed is lost and `softclose resume STORE` continues; 4 a limit of `sign`
is not met.
"""


class ExampleFormatter(click.HelpFormatter):
    """Continues an example that is wider than the page on the next line, as a shell reads it."""

    def write(self, string: str) -> None:
        """Write text; what is too wide and begins with the program's name is folded between arguments."""
        super().write(_EXAMPLE.sub(lambda found: folded(found[0], self.width), string))


_EXAMPLE = re.compile(r"^ +softclose .*$", re.MULTILINE)
_ARGUMENT = re.compile(r"""(?:"[^"]*"|'[^']*'|[^\s"'])+""")


def folded(example: str, width: int) -> str:
    """An indented command line in lines of at most `width` characters; no argument is cut, however long."""
    indent = example[: len(example) - len(example.lstrip())]
    lines = [indent]
    for argument in _ARGUMENT.findall(example):
        if lines[-1].strip() and len(f"{lines[-1]} {argument} \\") > width and len(example) > width:
            lines[-1] += " \\"
            lines.append(f"{indent}    {argument}")
        else:
            lines[-1] += f" {argument}" if lines[-1].strip() else argument
    return "\n".join(lines)


class HelpContext(click.Context):
    """Of every command: its help fits the page."""

    formatter_class = ExampleFormatter


class CommandGroup(click.Group):
    """Turns this project's own errors into one message and an exit code."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Expand `~` where a shell leaves it: `--store=~/a.zarr`, `--set population.name=~/lot.toml`, in quotes."""
        return super().parse_args(ctx, [_HOME.sub(_expanded, argument) for argument in args])

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The commands in groups, as somebody meets them, and not in one list by letter."""
        widest = max(len(name) for name in self.commands)
        for title, modules in COMMANDS.items():
            with formatter.section(title):
                formatter.write_dl([(name.replace("_", "-").ljust(widest), does) for name, does in modules.items()])

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; a fault of the program itself keeps its traceback."""
        try:
            with machine_faults():
                return super().invoke(ctx)
        except Stopped as e:
            _trace(ctx)
            _say(f"stopped: {e}")
            if (store := ctx.meta.get("softclose.store")) and not isinstance(e, StoreGoneError):
                _say(f"nothing committed is lost; continue with: softclose resume {store}")
            ctx.exit(EXIT_STOPPED)
        except ValueError as e:
            if type(e).__module__.partition(".")[0] not in ("softclose", "softclose_store", "softclose_workflows"):
                raise
            from softclose_store import DamageError  # not at the start: `--help` needs no store

            _trace(ctx)
            _say(str(e))
            ctx.exit(EXIT_DAMAGED if isinstance(e, DamageError) else EXIT_BAD_INPUT)


@functools.cache
def _leave_at_once() -> None:
    """At the end of this process nobody looks through all objects for what could be freed: it takes half a second."""
    atexit.register(gc.freeze)


_HOME = re.compile(r"^(?P<before>(?:--?[A-Za-z][\w-]*=)?(?:[\w.]+=)?)(?P<path>~(?:/.*)?)$", re.DOTALL)


def _expanded(found: re.Match[str]) -> str:
    return found["before"] + os.path.expanduser(found["path"])


def _trace(ctx: click.Context) -> None:
    """With --verbose: where the error came from."""
    if ctx.params.get("verbose"):
        import traceback

        click.echo(traceback.format_exc(), nl=False, err=True)


def _say(message: str) -> None:
    say(f"softclose: {message}", err=True)


@click.group(cls=CommandGroup, epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="softclose")
@click.option("--verbose", "-v", is_flag=True, help="Log what happens, and show where an error came from.")
@click.option(
    "--allow-code",
    multiple=True,
    metavar="MODULE:FUNCTION",
    help="Run this device model or engine of your own, where a configuration names it; repeatable.",
)
def main(verbose: bool, allow_code: tuple[str, ...]) -> None:
    """Design the drive-voltage pulses that close a whole production lot of MEMS switches softly."""
    from softclose import plugins

    _leave_at_once()
    os.environ.pop(plugins.ALLOWED, None)  # what is typed counts, and nothing else
    plugins.allow_code(*allow_code)
    if verbose:
        import logging

        logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(levelname)s: %(message)s")
    # A pipe closed early (| head) is no fault of ours; numbers print as UTF-8 wherever we are.
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="replace")


COMMANDS = {
    "Run": {
        "init": "Write a commented campaign file for your switch.",
        "populations": "List populations of switches, or describe one.",
        "calibrate": "Fit a population to measured devices.",
        "run": "Run a campaign: a shipped preset or your TOML file.",
        "resume": "Continue a campaign, after a kill too.",
        "bench": "Ask for waveforms and tell what devices did.",
        "submit": "Run a campaign as a job of a batch scheduler.",
        "status": "Say how far a campaign is; --watch follows it.",
    },
    "Judge": {
        "certify": "Judge the best candidates on new, unseen switches.",
        "sign": "Write a one-page sign-off against your limits.",
        "assess": "Judge a drive that you have recorded.",
        "rescore": "Rank the candidates by another objective.",
        "compare": "Compare the best designs of several campaigns.",
        "compare_engines": "Compare search engines on one problem.",
    },
    "Show": {
        "report": "Write one HTML page about a campaign.",
        "serve": "Show all campaigns of a folder in the browser, live.",
        "figures": "Write the figures of a campaign for publication.",
        "export": "Write waveform, switches or history to a file.",
        "pareto": "List the trade-offs between two to four objectives.",
        "opening": "Show how the switches open when they are released.",
    },
    "Robustness": {
        "tolerance": "Show what errors of the generator cost.",
        "sensitivity": "Show which parameters the spread comes from.",
        "tails": "Estimate rare failures, far below one in 10,000.",
        "drift": "Show how far pull-in voltages may drift.",
        "propagate": "Show what having measured few devices leaves open.",
    },
    "Paper": {
        "reproduce": "Reproduce the published study.",
        "study": "Run a campaign for each value of a parameter.",
    },
    "Administration": {
        "verify": "Check that a store is undamaged; repair it.",
        "tls": "Make a TLS certificate for your own cluster.",
        "completion": "Print the script that completes commands in a shell.",
    },
}
"""Modules of `commands`, each with what it does, in the groups and the order of `--help`. A module holds a command of
its own name."""

main.context_class = HelpContext
for _group in COMMANDS.values():
    for _name, _does in _group.items():
        _command = getattr(importlib.import_module(f"softclose_workflows.commands.{_name}"), _name)
        _command.short_help = _does
        for _each in (_command, *getattr(_command, "commands", {}).values()):
            _each.context_class = HelpContext
        main.add_command(_command)
