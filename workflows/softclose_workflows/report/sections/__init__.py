"""Owns which sections the report has: every module of this folder is one, and is shown by lying here."""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any

from softclose_workflows.report.section import Given, Section


def all_sections() -> list[Section[Any]]:
    """One of each class that the modules of the folder `sections` define, in the order of their places."""
    names = [f"{__name__}.{module.name}" for module in pkgutil.iter_modules(__path__)]
    kinds = [
        kind
        for name in names
        for kind in vars(importlib.import_module(name)).values()
        if isinstance(kind, type) and issubclass(kind, Section) and kind.__module__ == name
    ]
    return sorted((kind() for kind in kinds), key=lambda s: (s.place, s.name))


def found_in(given: Given) -> dict[str, Any]:
    """What each section finds in a store, by its name."""
    looked = {section.name: section.find(given) for section in all_sections()}
    return {name: found for name, found in looked.items() if found is not None}
