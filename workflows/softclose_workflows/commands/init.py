"""Owns `softclose init`."""

from __future__ import annotations

import sys
from typing import Any

import click


@click.command(
    epilog="\b\nExamples:\n  softclose init mine.toml --population lot7.toml --pulses 3 --max-volts 120\n"
    "  softclose init mine.toml --effort try\n  softclose init --schema softclose.schema.json"
)
@click.argument("file", metavar="[FILE]", required=False)
@click.option("--name", help="A title [my switch].")
@click.option("--population", help="A shipped population, or a population file [current].")
@click.option("--pulses", "n_pulses", type=click.IntRange(2, 3), help="Pulses of the waveform [2].")
@click.option(
    "--max-volts",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="V",
    help="What the amplifier can do [a half more than the stiffest switch pulls in at].",
)
@click.option(
    "--min-rise",
    "min_rise_us",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="µs",
    help="Fastest edge that amplifier and higher modes allow [4].",
)
@click.option(
    "--max-open", type=click.FloatRange(0.0, 1.0), help="Largest share of switches that may stay open [0.02]."
)
@click.option(
    "--effort",
    type=click.Choice(["try", "usual", "thorough"]),
    help="How much is searched [usual].",
)
@click.option("--schema", metavar="FILE", help="Write a JSON schema of campaign files for editors.")
@click.option("--force", is_flag=True, help="Replace an existing file.")
def init(file: str | None, schema: str | None, force: bool, **answers: Any) -> None:
    """Write a commented campaign file for your own switch, with ranges that suit its lot.

    What is not said by an option is asked at a terminal, and has its default elsewhere.
    """
    from pathlib import Path

    from softclose_workflows.analyses.starting import Start, starting_file
    from softclose_workflows.tell.outputs import OutputError, check_file, say_written, write_text
    from softclose_workflows.tell.plain import json_text

    if schema is not None:
        from softclose.settings.json_schema import configuration_schema

        check_file(schema, "--schema")
        write_text(schema, json_text(configuration_schema()) + "\n", "--schema")
        say_written([schema])
    if file is None:
        if schema is None:
            raise OutputError("give the name of the file to write, such as mine.toml, or --schema FILE")
        return
    target = check_file(file, "FILE", [".toml"])
    if Path(target).exists() and not force:
        raise OutputError(f"{target} exists already: give another name, or --force to replace it")
    given = {name: value for name, value in answers.items() if value is not None}
    if sys.stdin.isatty() and sys.stdout.isatty():
        given |= _asked(set(answers) - set(given))
    write_text(target, starting_file(Start(**given)), "FILE")
    say_written([str(target)])
    click.echo(f"look at it, then: softclose run {target} --store runs/{target.stem}.zarr --dry-run")


def _asked(missing: set[str]) -> dict[str, Any]:
    """What a person at the terminal says; Enter takes the default."""
    questions: dict[str, tuple[str, Any, Any]] = {
        "name": ("Title", "my switch", str),
        "population": ("Population (a shipped one, or your file)", "current", str),
        "n_pulses": ("Pulses of the waveform (2 or 3)", 2, click.IntRange(2, 3)),
        "min_rise_us": ("Fastest edge [µs]", 4.0, click.FloatRange(min=0.0, min_open=True)),
        "max_open": ("Largest share of switches that may stay open", 0.02, click.FloatRange(0.0, 1.0)),
        "effort": ("Effort", "usual", click.Choice(["try", "usual", "thorough"])),
    }
    return {
        name: click.prompt(text, default=default, type=kind)
        for name, (text, default, kind) in questions.items()
        if name in missing
    }
