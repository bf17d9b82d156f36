"""Owns `softclose tls`."""

from __future__ import annotations

import click


@click.command(epilog="\b\nExamples:\n  softclose tls ~/softclose-tls")
@click.argument("folder", metavar="FOLDER")
def tls(folder: str) -> None:
    """Make a TLS certificate for a Dask cluster of your own.

    It prints how to use it. FOLDER is readable by you alone and must be seen by every host of the cluster.
    """
    from softclose_workflows.run.certificates import make_certificates

    made = make_certificates(folder)
    click.echo(
        f"on every host, before anything of the cluster starts:\n"
        f"  export DASK_CONFIG={made.folder}\n"
        f"then, for example:\n"
        f"  dask scheduler --protocol tls --port 8786\n"
        f"  dask worker tls://SCHEDULER:8786 --nworkers 8 --nthreads 1\n"
        f"  softclose run current --store STORE --scheduler tls://SCHEDULER:8786"
    )
