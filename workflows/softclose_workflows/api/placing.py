"""Owns where calls from Python compute: the crew of an analysis, and the guard of the script that starts workers."""

from __future__ import annotations

import multiprocessing
import os
import sys
from contextlib import AbstractContextManager

from softclose_workflows.run.crew import Crew, open_crew
from softclose_workflows.run.executors import Placement


def crew_of(
    workers: int | None, scheduler: str | None, *, threads: int | None = None, store: str = ""
) -> AbstractContextManager[Crew]:
    """Who simulates for a function: threads of this process, one per core, unless workers or a scheduler are given.

    store: the campaign's, where pieces write into it. Raises ExecutorError for numbers that cannot be used.
    """
    check_main()
    return open_crew(Placement(workers=workers, scheduler=scheduler), threads=threads, store=store)


def check_main() -> None:
    """End a worker that imports the user's script: it would run it again, and start workers of its own."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        sys.stderr.write(
            'softclose: workers import the script that starts them: put its calls under `if __name__ == "__main__":`\n'
        )
        os._exit(1)
