"""Environments that Gymnasium makes by name, made known to it whichever of the two is imported first.

Gymnasium finds no plug-ins by itself, and it takes longer to import than all of this package: nobody who does not use
it should wait for it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType

NAME = "gymnasium"
ENVIRONMENTS = "greybox_lab.driving.racing.environment"


def register() -> None:
    """Make `greybox/Track-v0` known, now or once Gymnasium is imported."""
    if NAME in sys.modules:
        _known_to(sys.modules[NAME])
    elif not any(isinstance(item, _Afterwards) for item in sys.meta_path):
        sys.meta_path.insert(0, _Afterwards())


def _known_to(gymnasium: ModuleType) -> None:
    if "greybox/Track-v0" not in gymnasium.registry:
        gymnasium.register(
            "greybox/Track-v0",
            entry_point=f"{ENVIRONMENTS}:TrackEnv",
            vector_entry_point=f"{ENVIRONMENTS}:TrackVectorEnv",
        )


class _Afterwards(MetaPathFinder):
    """Waits for Gymnasium's import, once."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name != NAME:
            return None
        sys.meta_path.remove(self)
        result = find_spec(NAME)
        if result is not None and result.loader is not None:
            result.loader = _Registering(result.loader)
        return result


class _Registering(Loader):
    """Gymnasium's loader, after which our environments are known."""

    def __init__(self, own: Loader) -> None:
        self._own = own

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._own.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        self._own.exec_module(module)
        _known_to(module)
