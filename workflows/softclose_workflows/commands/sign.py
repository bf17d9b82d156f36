"""Owns `softclose sign`."""

from __future__ import annotations

import click


@click.command(
    epilog="\b\nExamples:\n  softclose sign runs/a.zarr --limit v_u=20 --limit p_nc=8% --limit peak=150\n"
    "  softclose sign runs/a.zarr --limits limits.toml --limit hold_margin=20 -o release.html\n"
    "  softclose sign runs/a.zarr --limits limits.toml --json > release.json"
)
@click.argument("store", metavar="STORE")
@click.option(
    "--limit",
    "texts",
    multiple=True,
    metavar="NAME=NUMBER",
    help="A limit, in the quantity's unit: a largest value, or a least one for hold_margin, contact_force and "
    "release_force. Repeatable.",
)
@click.option("--limits", "file", metavar="FILE", help="A TOML file of such limits, one `name = number` a line.")
@click.option(
    "-o", "--output", metavar="FILE", help="Where to write the page [the store's name with -sign.html, in this folder]."
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for a release process, in place of the page.")
@click.option("--quiet", "-q", is_flag=True, help="Say nothing but what went wrong.")
@click.pass_context
def sign(
    ctx: click.Context,
    store: str,
    texts: tuple[str, ...],
    file: str | None,
    output: str | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Write a sign-off page for the best certified waveform in STORE: one sheet of paper.

    It holds the waveform against your limits on the certificate's new switches, and names everything that the verdict
    rests on: waveform and hash, lot, assumptions, versions, date. A limit passes where the whole interval keeps it.
    The exit code is 4 where a limit is missed or not established.
    """
    from softclose.tables import at_home, read_tables
    from softclose_workflows.analyses.signing import SignError, parsed_limits, sheet_to_json
    from softclose_workflows.analyses.signing import sign as held
    from softclose_workflows.errors import EXIT_NOT_PASSED
    from softclose_workflows.report.sign_page import render_sign
    from softclose_workflows.tell.outputs import check_file, default_name, say_written, write_text
    from softclose_workflows.tell.plain import json_text
    from softclose_workflows.terminal import say, working

    table = None if file is None else read_tables(at_home(file), "the file of limits", SignError)
    limits = parsed_limits(texts, table)
    path = output or default_name(store, "-sign.html")
    if not as_json:
        check_file(path)
    with working("holding the waveform against its limits", quiet=quiet):
        sheet = held(store, limits)
    if as_json:
        click.echo(json_text(sheet_to_json(sheet)))
    else:
        write_text(path, render_sign(sheet))
        if not quiet:
            click.echo(f"verdict: {sheet.verdict}")
            for warning in sheet.warnings:
                say(warning)
            say_written([path])
    if sheet.verdict in ("fail", "not established"):
        ctx.exit(EXIT_NOT_PASSED)
