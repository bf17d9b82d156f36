"""Owns `softclose submit`."""

from __future__ import annotations

import click


@click.command(
    epilog="\b\nExamples:\n  softclose submit current-three --store runs/a.zarr --cluster slurm.toml --dry-run\n"
    "  softclose submit mine.toml --store runs/b.zarr --cluster slurm.toml --set campaign.seed=7 --walltime 12:00:00"
)
@click.argument("source", metavar="PRESET|FILE")
@click.option("--store", required=True, metavar="PATH", help="Where the campaign is kept: a path or a URL.")
@click.option("--set", "overrides", multiple=True, metavar="SECTION.KEY=VALUE", help="Override a setting; repeatable.")
@click.option("--cluster", required=True, metavar="FILE", help="The workers' jobs, as `softclose run` takes them.")
@click.option("--walltime", default="24:00:00", show_default=True, help="Of the driver's job.")
@click.option("--memory", default="4G", show_default=True, help="Of the driver's job.")
@click.option("--turns", type=int, default=100, show_default=True, help="Jobs that follow each other, at most.")
@click.option("--dry-run", is_flag=True, help="Show the two scripts and submit nothing.")
def submit(
    source: str,
    store: str,
    overrides: tuple[str, ...],
    cluster: str,
    walltime: str,
    memory: str,
    turns: int,
    dry_run: bool,
) -> None:
    """Run a campaign as a SLURM job that goes on in another job until it is complete.

    The driver's job starts the workers' jobs (--cluster). Where it ends early, by its walltime, cancelled or with its
    node, the next one, queued already, resumes the campaign.
    """
    from softclose.settings import load_config
    from softclose_workflows.run.executors.batch import job_script
    from softclose_workflows.run.executors.cluster_file import load_cluster
    from softclose_workflows.run.submission import DriverJob, submission
    from softclose_workflows.run.submission import submit as submit_job
    from softclose_workflows.terminal import READING, working

    with working(READING, quiet=False):
        load_config(source, overrides)
    spec = load_cluster(cluster)
    arguments = ["run", source, "--store", store, "--cluster", cluster, "--quiet"]
    for setting in overrides:
        arguments += ["--set", setting]
    planned = submission(store, arguments, spec, DriverJob(walltime=walltime, memory=memory, turns=turns))
    if dry_run:
        click.echo(f"# {planned.path}\n{planned.text}")
        click.echo(f"# each of {spec.jobs} jobs of workers; addresses and certificates are those of the run")
        click.echo(job_script(spec))
        return
    number = submit_job(planned)
    click.echo(
        f"job {number} ({planned.name}); its output: {planned.path.parent}/{planned.name}-{number}.log\n"
        f"follow it:  softclose status {store} --watch\n"
        f"end it:     scancel --name {planned.name}"
    )
