"""Owns `softclose serve`."""

from __future__ import annotations

import click


@click.command(
    epilog="\b\nExamples:\n  softclose serve runs\n  softclose serve runs --port 8051\n\n\b\n"
    "From another machine: ssh -L 8050:127.0.0.1:8050 HOST, then\nhttp://127.0.0.1:8050/"
)
@click.argument("folder", metavar="FOLDER", type=click.Path())
@click.option("--port", type=click.IntRange(0, 65535), default=8050, show_default=True, help="0: any that is free.")
def serve(folder: str, port: int) -> None:
    """Show all campaigns of FOLDER in the browser, as they run: progress, the best, their reports.

    On this machine's loopback only, and read-only. Ctrl-C ends it; the campaigns go on.
    """
    import signal
    from pathlib import Path

    from softclose_workflows.report.live import Server
    from softclose_workflows.tell.outputs import OutputError

    path = Path(folder)
    if not path.is_dir():
        raise OutputError(f"{folder} is no folder; give the one that your stores are in, or a store")
    try:
        server = Server(path.absolute(), port)
    except OSError as e:
        raise OutputError(f"port {port} cannot be used ({e.strerror or e}); give another (--port 0: any)") from e

    def end(*_: object) -> None:
        raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)  # also where the shell that started it in the background has them ignored
    with server:
        click.echo(f"{folder}: {server.address} (Ctrl-C ends it)")
        try:
            server.serve_forever(poll_interval=0.2)
        except KeyboardInterrupt:
            server.ending.set()
