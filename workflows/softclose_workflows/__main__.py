"""`python -m softclose_workflows` is `softclose`."""

from softclose_workflows.cli import main

main(prog_name="softclose")
