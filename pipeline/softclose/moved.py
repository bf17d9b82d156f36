"""Owns the addresses of version 0.1: `softclose.calibrate` and its like still import what has moved to a room."""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
from collections.abc import Sequence
from types import ModuleType

MOVED = {
    "softclose.calibrate": "softclose.population.calibrate",
    "softclose.intervals": "softclose.metrics.intervals",
    "softclose.measurements": "softclose.population.measurements",
    "softclose.objective": "softclose.metrics.objective",
    "softclose.spaces": "softclose.waveform.spaces",
    "softclose.sensitivity": "softclose.uncertainty.sensitivity",
    "softclose.tolerance": "softclose.uncertainty.tolerance",
}
"""Documented address -> where it is now."""


class _Moved(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Answers an old address with the very module that moved: its classes are the same objects."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        return importlib.util.spec_from_loader(fullname, self) if fullname in MOVED else None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        module = importlib.import_module(MOVED[spec.name])
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Nothing is left to run; the import system has put the old address's spec into the module."""
        assert module.__spec__ is not None
        module.__spec__ = module.__spec__.loader_state


def keep_old_addresses() -> None:
    """Once a process: look here for what no folder has any more."""
    if not any(isinstance(finder, _Moved) for finder in sys.meta_path):
        sys.meta_path.append(_Moved())
