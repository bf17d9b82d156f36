"""Owns `softclose rescore`."""

from __future__ import annotations

import click


@click.command(
    epilog="\b\nExamples:\n  softclose rescore runs/a.zarr --level 0.99\n"
    "  softclose rescore runs/a.zarr --form chance --p-max 0.02 --closed-by 100 --json"
)
@click.argument("store", metavar="STORE")
@click.option("--level", type=float, help="Quantile of V that is v_u.")
@click.option("--c1", "c1_cm_s", type=float, help="Penalty per unit probability of not closing [cm/s].")
@click.option("--max-open", type=float, help="Candidates that leave a larger fraction open rank behind all others.")
@click.option("--limit", "limits", type=float, multiple=True, help="Report P(V > limit) [cm/s]; repeatable.")
@click.option("--form", type=click.Choice(["penalty", "chance"]), help="Form of the objective.")
@click.option("--p-max", type=float, help="Largest admissible p_nc of the chance-constrained form.")
@click.option("--confidence", type=float, help="Confidence of the intervals.")
@click.option(
    "--closed-by",
    "closed_by_us",
    type=float,
    metavar="T_US",
    help="Closed means held from this instant, or earlier, to the horizon [µs].",
)
@click.option(
    "--impacts", type=click.Choice(["all", "first"]), default="all", show_default=True, help="Impacts that count for V."
)
@click.option(
    "--impacts-until",
    "impacts_until_us",
    type=float,
    metavar="T_US",
    help="Only impacts until this instant count for V [µs].",
)
@click.option(
    "--rows",
    type=click.IntRange(min=1),
    default=10,
    show_default=True,
    help="Candidates in the table (--json has all).",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
def rescore(
    store: str,
    level: float | None,
    c1_cm_s: float | None,
    max_open: float | None,
    limits: tuple[float, ...],
    form: str | None,
    p_max: float | None,
    confidence: float | None,
    closed_by_us: float | None,
    impacts: str,
    impacts_until_us: float | None,
    rows: int,
    as_json: bool,
) -> None:
    """Rank the candidates of STORE under another objective, from its stored events, without simulating.

    What is not given stays as the campaign has it.
    """
    from softclose_workflows.analyses.rescore import Score
    from softclose_workflows.analyses.rescore import rescore as run
    from softclose_workflows.run.records import assessment_record
    from softclose_workflows.tell.console import wide_console
    from softclose_workflows.tell.plain import json_text
    from softclose_workflows.tell.tables import metrics_row

    given = {
        "level": level,
        "c1_cm_s": c1_cm_s,
        "max_open": max_open,
        "form": form and f'"{form}"',
        "p_max": p_max,
        "confidence": confidence,
        "limits_cm_s": list(limits) or None,
    }
    ranking = run(
        store,
        Score(
            objective=tuple(f"{key}={value}" for key, value in given.items() if value is not None),
            closed_by_us=closed_by_us,
            impacts=impacts,
            impacts_until_us=impacts_until_us,
        ),
    )
    if as_json:
        candidates = [
            {
                "candidate": r.candidate,
                "rank": r.rank,
                "rank_before": r.rank_before,
                "g_before_cm_s": r.g_before_cm_s,
                "n_switches": r.n_switches,
                **r.assessment.to_dict(),
            }
            for r in ranking
        ]
        click.echo(json_text({"store": store, "candidates": candidates}))
        return
    from rich.table import Table

    table = Table(title=f"{store}, rescored", title_justify="left")
    for column in ("rank", "before", "candidate", "switches", "v_u [cm/s]", "mean V [cm/s]", "left open", "g [cm/s]"):
        table.add_column(column, justify="right", no_wrap=True)
    for r in ranking[:rows]:
        table.add_row(
            str(r.rank),
            str(r.rank_before),
            str(r.candidate),
            str(r.n_switches),
            *metrics_row(assessment_record(r.assessment)),
        )
    console = wide_console()
    console.print(table)
    if ranking and ranking[0].assessment.open_warning:
        console.print(ranking[0].assessment.open_warning)
    limit = ranking[0].assessment.limit if ranking else None
    if limit is not None:
        console.print(f"candidate {ranking[0].candidate}: {limit.sentence}")
