"""Owns, from Python, a campaign on a test bench: what `softclose bench` does, and a loop of your own."""

from softclose_workflows.bench.session import Bench as Bench
from softclose_workflows.bench.session import Suggestion as Suggestion
