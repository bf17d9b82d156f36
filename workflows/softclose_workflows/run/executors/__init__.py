"""Where blocks run: in this process, on a local cluster, on a scheduler somewhere. One executor a file."""

from softclose_workflows.run.executors.placement import Placement as Placement
from softclose_workflows.run.executors.placement import open_executor as open_executor
from softclose_workflows.run.executors.protocol import Executor as Executor
