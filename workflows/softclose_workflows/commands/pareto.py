"""Owns `softclose pareto`."""

from __future__ import annotations

import click


@click.command(epilog="\b\nExamples:\n  softclose pareto runs/a.zarr\n  softclose pareto runs/a.zarr --json")
@click.argument("store", metavar="STORE")
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
def pareto(store: str, as_json: bool) -> None:
    """The candidates of STORE that no other beats in both v_u and p_nc, and how the area that they dominate grew.

    Of those evaluated on the most switches only: smaller ensembles flatter, and do not compare.
    """
    import math

    import numpy as np

    from softclose.metrics.pareto import hypervolume, pareto_front
    from softclose_store import open_campaign
    from softclose_workflows.analyses.certify import CertifyError
    from softclose_workflows.tell.console import wide_console
    from softclose_workflows.tell.plain import json_text, waveform_rows
    from softclose_workflows.tell.tables import describe_waveform, metrics_row

    campaign = open_campaign(store)
    table = campaign.records()
    usable = ~table["failed"] & np.isfinite(table["v_u_cm_s"])
    if not usable.any():
        raise CertifyError(f"{store} has no usable candidate yet: let the campaign run first")
    n = int(table["n_switches"][usable].max())
    usable &= table["n_switches"] == n
    v_u = np.where(usable, table["v_u_cm_s"], np.nan)
    front = [int(i) for i in pareto_front(v_u, table["p_nc"])]
    records = [{name: column[i] for name, column in table.items()} for i in front]
    waveforms = [waveform_rows(campaign.waveform(i)) for i in front]
    worst = campaign.config["objective"]["undefined_v_u_cm_s"]
    quarters = [math.ceil(q * len(v_u) / 4) for q in (1, 2, 3, 4)]
    volumes = [hypervolume(v_u[:k], table["p_nc"][:k], worst_v_u_cm_s=worst) for k in quarters]
    if as_json:
        rows = [
            {
                "candidate": i,
                "v_u_cm_s": float(r["v_u_cm_s"]),
                "v_u_interval_cm_s": [float(r["v_u_lower_cm_s"]), float(r["v_u_upper_cm_s"])],
                "p_nc": float(r["p_nc"]),
                "p_nc_interval": [float(r["p_nc_wilson_lower"]), float(r["p_nc_wilson_upper"])],
                "mean_cm_s": float(r["mean_cm_s"]),
                "g_cm_s": float(r["g_cm_s"]),
                "waveform": w,
            }
            for i, r, w in zip(front, records, waveforms, strict=True)
        ]
        click.echo(
            json_text(
                {
                    "store": store,
                    "n_switches": n,
                    "front": rows,
                    "hypervolume_cm_s": dict(zip(quarters, volumes, strict=True)),
                }
            )
        )
        return
    from rich.table import Table

    shown = Table(title=f"{store}: v_u against p_nc, {n:,} switches", title_justify="left", show_lines=True)
    shown.add_column("candidate", justify="right")
    shown.add_column("waveform")
    for column in ("v_u \\[cm/s]", "mean V \\[cm/s]", "p_nc", "g \\[cm/s]"):
        shown.add_column(column, justify="right", no_wrap=True)
    for i, record, waveform in zip(front, records, waveforms, strict=True):
        shown.add_row(str(i), describe_waveform(waveform), *metrics_row(record))
    wide_console().print(shown)
    said = ", ".join(f"{volume:.3f} after {k:,}" for k, volume in zip(quarters, volumes, strict=True))
    click.echo(f"hypervolume below v_u {worst:g} cm/s and p_nc 1 [cm/s]: {said} candidates")
