"""Owns `softclose verify`."""

from __future__ import annotations

import click

from softclose_workflows.commands.options import break_lock_option


@click.command(
    epilog="\b\nExamples:\n  softclose verify runs/a.zarr\n  softclose verify runs/a.zarr --replay 20\n"
    "  softclose verify runs/a.zarr --repair\n\n\b\nExit code 1: damage was found, or a bit came out otherwise."
)
@click.argument("store", metavar="STORE")
@click.option(
    "--replay",
    "n_replay",
    type=click.IntRange(min=1),
    metavar="K",
    help="Compute K random blocks and propose K random waves again and compare bits.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Which K.")
@click.option(
    "--repair",
    is_flag=True,
    help="Compute again what is damaged or missing, and prove it equal; commit what was measured.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@break_lock_option
@click.pass_context
def verify(
    ctx: click.Context, store: str, n_replay: int | None, seed: int, repair: bool, as_json: bool, break_lock: bool
) -> None:
    """Check that STORE holds what was written: checksums, markers against data, records, schema, fingerprint."""
    from softclose_store import repair as repair_store
    from softclose_store import verify as verify_store
    from softclose_workflows.analyses.recompute import recompute, replay
    from softclose_workflows.run.measurements import commit_told
    from softclose_workflows.tell.plain import json_text

    told: dict[str, object] = {"store": store}
    lines = []
    if repair:
        mended = repair_store(store, recompute(), break_lock=break_lock)
        report = mended.after
        told |= {"proved": list(mended.proved), "unproved": list(mended.unproved), "failed": list(mended.failed)}
        lines += [f"repaired and proved equal: {what}" for what in mended.proved]
        lines += [f"repaired, nothing left to compare with: {what}" for what in mended.unproved]
        lines += [f"not repaired: {what}" for what in mended.failed]
        if report.ok and (n_told := commit_told(store, break_lock=break_lock)):
            told["committed"] = n_told
            lines.append(f"committed what was measured and told, but not committed: candidates {n_told:,}")
            report = verify_store(store)
    else:
        report = verify_store(store)
    ok = report.ok
    told |= {
        "candidates": report.n_committed,
        "blocks": report.n_blocks,
        "damage": [str(p) for p in report.problems],
        "left_behind": list(report.orphans),
        "extension": report.extension,
        "unlisted": list(report.unlisted),
    }
    lines += [f"damage: {problem}" for problem in report.problems]
    lines.append(
        f"{report.n_committed} candidates and {report.n_blocks} blocks read: {_verdict(len(report.problems), store)}"
    )
    if report.extension:
        lines.append(
            f"an extension to {report.extension} candidates was cut off: harmless, `softclose resume` and --repair "
            "complete it"
        )
    if report.unlisted:
        lines.append(
            f"{', '.join(report.unlisted)}: whole, and not in the root's list, so that xarray's open_datatree does not "
            "show it yet: a run that ends, `softclose resume` and --repair list it"
        )
    if report.orphans:
        lines.append(f"{len(report.orphans)} temporary files left behind by a kill: harmless, --repair removes them")
    if n_replay is not None and ok:
        again = replay(store, n_replay, seed)
        ok = again.ok
        told |= {
            "replayed_blocks": [list(b) for b in again.blocks],
            "replayed_waves": list(again.waves),
            "differing": list(again.differing),
        }
        lines += [f"differs: {what}" for what in again.differing]
        same = "every bit the same" if again.ok else f"{len(again.differing)} differ"
        lines.append(f"{len(again.blocks)} blocks and {len(again.waves)} waves computed again: {same}")
    told["ok"] = ok
    click.echo(json_text(told) if as_json else "\n".join(lines))
    if not ok:
        ctx.exit(1)


def _verdict(n: int, store: str) -> str:
    return "all as written" if n == 0 else f"{n} damaged; `softclose verify {store} --repair` computes them again"
