"""Imports at first use: pandas takes a quarter of a second, parts of numpy that scipy imports a twentieth."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any


class _Late(ModuleType):
    """A module that is imported where one of its attributes is first used."""

    def __getattr__(self, attribute: str) -> Any:
        for finder in sys.meta_path:
            if isinstance(finder, LateImports) and self.__name__ in finder.names:
                finder.names.remove(self.__name__)
                sys.modules.pop(self.__name__, None)
        return getattr(import_module(self.__name__), attribute)


class LateImports:
    """Finds and loads some modules, before anyone else does, as modules that are imported at their first use.

    Only for a whole process: other libraries get such modules, too.
    """

    def __init__(self, *names: str) -> None:
        self.names = {name for name in names if name not in sys.modules}

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """Find these modules alone."""
        return ModuleSpec(name, self) if name in self.names else None  # type: ignore[arg-type]

    def create_module(self, spec: ModuleSpec) -> None:
        """A module as usual."""

    def exec_module(self, module: ModuleType) -> None:
        """Nothing is imported yet."""
        module.__class__ = _Late
