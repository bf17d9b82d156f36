"""Owns what can be plugged in, by name: engines and device models, those shipped and those installed as entry points.

Names are checked without importing what they stand for: reading a configuration needs no compiler and no optimiser.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any

from softclose.naming import unknown_name


class EngineError(ValueError):
    """An engine that does not exist, is not installed, or does not fit the search space."""


class ModelError(ValueError):
    """A device model that is not installed."""


class QuantityError(ValueError):
    """A quantity that does not exist, or that a response does not tell."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plugin:
    """One kind of thing that can be plugged in."""

    what: str
    """What messages call it."""
    group: str
    """Group of the entry points."""
    key: str
    """Setting that names it."""
    shipped: Mapping[str, str]
    """Name -> `module:attribute` of those that come with the package."""
    error: type[ValueError]
    """Raised for a name that is not known."""

    def names(self) -> tuple[str, ...]:
        """Those shipped, then those installed."""
        return (*self.shipped, *sorted(e.name for e in entry_points(group=self.group)))

    def check(self, name: str) -> None:
        """Raise `error`, naming the nearest known one, where there is none of that name. Imports none.

        `module:function` is a name where the user has allowed that very one (`allow_code`).
        """
        if name in self.shipped:  # what is installed is not asked for: looking through every package takes 30 ms
            return
        if is_code(name):
            if name not in allowed_code():
                raise self.error(
                    f"{self.key} is {name}, which is code. It runs only where you say so yourself, never because a "
                    f"file or a store names it: softclose --allow-code {name} …, or softclose.allow_code({name!r})"
                )
            module = name.partition(":")[0]
            if not _is_here(module):
                raise self.error(
                    f"{self.key} is {name}, and there is no module {module}: stand in its folder ({os.getcwd()} is "
                    "searched), or install it"
                )
            return
        if name not in self.names():
            raise self.error(
                f"{unknown_name(self.what, name, self.names(), self.key)}. One of your own comes with the package that "
                f"declares the entry point {name} of group {self.group}: install it"
            )

    def load(self, name: str) -> Any:
        """The object of that name; imports only that one."""
        if name in self.shipped:
            return load_object(self.shipped[name])
        self.check(name)
        try:
            if is_code(name):
                return load_object(name)
            return next(e for e in entry_points(group=self.group) if e.name == name).load()
        except Exception as e:  # somebody else's module may raise anything while it is imported
            raise self.error(f"{self.what} {name!r} cannot be loaded: {type(e).__name__}: {e}") from e


ALLOWED = "SOFTCLOSE_ALLOWED_CODE"
"""Environment variable by which worker processes learn what their user has allowed; the command line begins without."""

_CODE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*", re.ASCII)


def is_code(name: str) -> bool:
    """Whether a name is that of an object of a module, `module:function`."""
    return _CODE.fullmatch(name) is not None


def allowed_code() -> tuple[str, ...]:
    """What may be run beside what is installed."""
    return tuple(os.environ.get(ALLOWED, "").split())


def allow_code(*names: str) -> None:
    """Let `optimiser.engine` and `model.name` be these functions of modules, in this process and those that it starts.

    The folder that one stands in is searched last for their modules. Nothing but a call of this function, or the
    flag that a user types, allows them: what a store or a file names is not run for that.

    Parameters
    ----------
    *names : str
        `module:function` each.

    Raises
    ------
    EngineError
        For another form.
    """
    for name in names:
        if not (isinstance(name, str) and is_code(name)):
            raise EngineError(f"{name!r} is no code to allow; give module:function, such as my_switch:simulate")
    os.environ[ALLOWED] = " ".join(dict.fromkeys((*allowed_code(), *names)))


def _look_here() -> None:
    """Search the folder that one stands in for modules too: last, so that it hides nothing that is installed."""
    if (here := os.getcwd()) not in sys.path:
        sys.path.append(here)


def _is_here(module: str) -> bool:
    """Whether a module can be found; imports none but the packages that it lies in."""
    _look_here()
    try:
        return importlib.util.find_spec(module) is not None
    except ImportError:
        return False


def load_object(target: str) -> Any:
    """The object at `module:attribute`."""
    module, _, attribute = target.partition(":")
    if target in allowed_code():
        _look_here()
    return getattr(importlib.import_module(module), attribute)


ENGINES = Plugin(
    what="engine",
    group="softclose.engines",
    key="optimiser.engine",
    shipped={
        "sobol": "softclose.propose.sobol:SobolEngine",
        "skopt": "softclose.propose.skopt_engine:SkoptEngine",
        "paper": "softclose.propose.paper:PaperEngine",
        "direct": "softclose.propose.direct:DirectEngine",
        "cmaes": "softclose.propose.cmaes:CmaesEngine",
        "botorch": "softclose.propose.botorch:BotorchEngine",
        "parego": "softclose.propose.parego:ParegoEngine",
        "nsga2": "softclose.propose.nsga2:Nsga2Engine",
    },
    error=EngineError,
)
"""Whoever proposes waveforms; see `softclose.propose.protocol.Engine`."""

SINGLE_MODE = "single-mode"
"""The model of Eqs. 1-2, `softclose.simulate`."""

REDUCED_ORDER = "reduced-order"
"""Several modes: `softclose.simulate` with those of the campaign."""

MEASURED = "measured"
"""No model: a generator drives devices, and somebody measures how they close."""

MODELS = Plugin(
    what="device model",
    group="softclose.models",
    key="model.name",
    shipped={
        SINGLE_MODE: "softclose.device.simulate:simulate",
        REDUCED_ORDER: "softclose.device.simulate:simulate",
        MEASURED: "softclose.device.protocol:measured",
    },
    error=ModelError,
)
"""Whatever answers a waveform; see `softclose.device.protocol.DeviceModel`."""
