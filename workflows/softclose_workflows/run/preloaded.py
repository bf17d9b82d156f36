"""Owns what is imported once for all workers of this machine (`softclose_workflows.run.forking`)."""

import sys

import distributed.nanny  # noqa: F401

from softclose.propose.descents import library
from softclose_workflows.run import prior, tasks, workers

__all__ = ["prior", "tasks", "workers"]

library()
# What keeps a worker from starting is told by whoever wants it, in one line.
sys.excepthook = lambda *_: None
