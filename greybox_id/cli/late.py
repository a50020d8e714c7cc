"""Imports at first use: pandas takes a quarter of a second, and many commands do without."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any


class _Late(ModuleType):
    """A module that is imported where one of its attributes is first used."""

    def __getattr__(self, attribute: str) -> Any:
        for finder in list(sys.meta_path):
            if isinstance(finder, LateImport) and finder.name == self.__name__:
                sys.meta_path.remove(finder)
                sys.modules.pop(self.__name__, None)
        return getattr(import_module(self.__name__), attribute)


class LateImport:
    """Finds and loads a module of this name, before anyone else does, as one to be imported at its first use.

    Only for a whole process: other libraries get such a module, too.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    @staticmethod
    def of(name: str) -> None:
        """Import a module at its first use, from now on, unless it is imported already."""
        if name not in sys.modules:
            sys.meta_path.insert(0, LateImport(name))

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """Find this module alone."""
        return ModuleSpec(name, self) if name == self.name else None  # type: ignore[arg-type]

    def create_module(self, spec: ModuleSpec) -> None:
        """A module as usual."""

    def exec_module(self, module: ModuleType) -> None:
        """Nothing is imported yet."""
        module.__class__ = _Late
