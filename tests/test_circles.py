"""No modules of the library or the laboratory import each other in a circle, not even when called or for types."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FILES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in ("greybox_id", "greybox_lab")
    for path in (ROOT / package).rglob("*.py")
}


def imports(name: str, path: Path) -> set[str]:
    """Modules that a file imports anywhere; a package's name counts where its `__init__` holds what is taken."""
    result = set[str]()
    inside = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            result |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = inside[: len(inside) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            result |= {f"{base}.{a.name}" if f"{base}.{a.name}" in FILES else base for a in node.names}
    return (result & FILES.keys()) - {name}


def circle(graph: dict[str, set[str]]) -> list[str]:
    """The names along a circle; empty where there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_modules_import_in_no_circle():
    assert circle({name: imports(name, path) for name, path in FILES.items()}) == []


@pytest.mark.parametrize(
    "line", ["from . import b", "from .b import x", "import pack.b", "def f():\n from .b import x"]
)
def test_a_circle_is_found(line, tmp_path, monkeypatch):
    monkeypatch.setattr("tests.test_circles.FILES", {"pack.a": tmp_path / "a.py", "pack.b": tmp_path / "b.py"})
    (tmp_path / "a.py").write_text(line)
    (tmp_path / "b.py").write_text("from pack import a")
    assert circle({name: imports(name, tmp_path / f"{name[-1]}.py") for name in ("pack.a", "pack.b")})
