"""Owns `softclose tolerance`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from softclose_workflows.commands.options import crew_options, quiet_option

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement


@click.command(
    epilog="\b\nExamples:\n  softclose tolerance runs/a.zarr\n"
    "  softclose tolerance runs/a.zarr --gain 0.02 --jitter 0.2 --slew 40 --json"
)
@click.argument("store", metavar="STORE")
@click.option("--candidate", type=int, help="Candidate [the best certified one, or else the best].")
@click.option("--switches", type=click.IntRange(min=1), default=20_000, show_default=True, help="New switches.")
@click.option(
    "--generators",
    type=click.IntRange(min=1),
    default=64,
    show_default=True,
    help="Generators drawn where errors are random.",
)
@click.option("--gain", type=float, multiple=True, help="Relative gain error, e.g. 0.01; repeatable.")
@click.option("--gain-sd", type=float, multiple=True, help="Its standard deviation between generators; repeatable.")
@click.option("--jitter", type=float, multiple=True, help="Standard deviation of pulse starts [µs]; repeatable.")
@click.option("--slew", type=float, multiple=True, help="Steepest slope of the generator [V/µs]; repeatable.")
@crew_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@quiet_option
def tolerance(
    store: str,
    candidate: int | None,
    switches: int,
    generators: int,
    gain: tuple[float, ...],
    gain_sd: tuple[float, ...],
    jitter: tuple[float, ...],
    slew: tuple[float, ...],
    placement: Placement,
    as_json: bool,
    quiet: bool,
) -> None:
    """Show how v_u and the share left open of a waveform in STORE change with errors of its generator.

    Each error by itself, on new switches: those of the certification, as many of them as asked for.
    Without any error given, a usual set of them.
    """
    from softclose.uncertainty.tolerance import DriveError
    from softclose_workflows.analyses.drive_errors import describe
    from softclose_workflows.analyses.drive_errors import tolerance as run
    from softclose_workflows.run.crew import open_crew
    from softclose_workflows.tell.console import bar, wide_console
    from softclose_workflows.tell.labels import signed
    from softclose_workflows.tell.plain import json_text, waveform_rows
    from softclose_workflows.tell.tables import points, share_open, with_interval

    asked = [
        *(DriveError(gain=x) for x in gain),
        *(DriveError(gain_sd=x) for x in gain_sd),
        *(DriveError(jitter_us=x) for x in jitter),
        *(DriveError(slew_volts_per_us=x) for x in slew),
    ]
    with bar("simulating", quiet=quiet) as listener, open_crew(placement) as crew:
        chosen, rows = run(
            store,
            asked,
            candidate=candidate,
            n_switches=switches,
            n_generators=generators,
            mapper=crew,
            listener=listener,
        )
    if as_json:
        said = [
            {
                "error": describe(r.error),
                "gain": r.error.gain,
                "gain_sd": r.error.gain_sd,
                "jitter_us": r.error.jitter_us,
                "slew_volts_per_us": r.error.slew_volts_per_us,
                "v_u_shift_cm_s": r.v_u_shift_cm_s,
                "p_nc_shift": r.p_nc_shift,
                **r.assessment.to_dict(),
            }
            for r in rows
        ]
        whole = {
            "store": store,
            "candidate": chosen.candidate,
            "why": chosen.why,
            "n_switches": switches,
            "waveform": waveform_rows(chosen.waveform.rows()),
            "rows": said,
        }
        click.echo(json_text(whole))
        return
    from rich.table import Table

    table = Table(
        title=f"candidate {chosen.candidate} ({chosen.why}) on {switches:,} new switches", title_justify="left"
    )
    table.add_column("generator")
    for column in ("v_u [cm/s]", "change", "left open", "change", "g [cm/s]"):
        table.add_column(column, justify="right", no_wrap=True)
    for r in rows:
        a = r.assessment
        table.add_row(
            describe(r.error),
            with_interval(a.v_u_cm_s, *a.v_u_interval),
            signed(r.v_u_shift_cm_s, 2),
            share_open(a.p_nc, a.p_nc_intervals.wilson, a.n_failed),
            points(r.p_nc_shift),
            f"{a.g_cm_s:.2f}",
        )
    wide_console().print(table)
