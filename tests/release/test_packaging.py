"""The wheel holds the package and nothing else, the source distribution what builds and tests it."""

import importlib.util
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

from greybox_id.base.version import __version__

ROOT = Path(__file__).parents[2]
LARGEST_WHEEL = 3e6
"""Bytes: a wheel that is larger holds something that does not belong in it."""


def _tracked():
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("this is no clone")
    return [name for name in listed.stdout.splitlines() if (ROOT / name).exists()]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Wheel and source distribution of the files that are tracked, built without the network."""
    if importlib.util.find_spec("build") is None:
        pytest.skip("build is not installed; make test installs it")
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("dist")
    for name in _tracked():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, source / name, follow_symlinks=False)
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(source)]
    made = subprocess.run(command, capture_output=True, text=True)
    assert made.returncode == 0, made.stdout[-3000:] + made.stderr[-3000:]
    return next(out.glob("*.whl")), next(out.glob("*.tar.gz"))


@pytest.mark.slow
def test_the_wheel_holds_the_package_alone(built):
    wheel, _ = built
    assert wheel.name == f"greybox_id-{__version__}-py3-none-any.whl"
    assert wheel.stat().st_size < LARGEST_WHEEL
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        about = Parser().parsestr(archive.read(f"greybox_id-{__version__}.dist-info/METADATA").decode())
    tops = {name.split("/")[0] for name in names}
    assert tops == {"greybox_id", "greybox_lab", f"greybox_id-{__version__}.dist-info"}
    held = {name for name in names if name.startswith(("greybox_id/", "greybox_lab/"))}
    packaged = {name for name in _tracked() if name.startswith(("greybox_id/", "greybox_lab/"))}
    assert packaged - held == set(), "not in the wheel"
    assert held - packaged == set(), "in the wheel, and tracked by nobody"
    recordings = {name for name in held if name.endswith((".csv", ".parquet", ".mcap", ".mf4"))}
    assert all(name.startswith("greybox_id/datasets/shipped/") for name in recordings)
    assert about["Version"] == __version__
    assert about["License-Expression"] == "MIT"


@pytest.mark.slow
def test_the_source_distribution_holds_what_builds_and_tests_it(built):
    _, source = built
    with tarfile.open(source) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    needed = {"CITATION.cff", "SECURITY.md", "constraints.txt", "docs/tutorial.md", "tests/conftest.py", "LICENSE"}
    assert needed - names == set()
    assert not any(name.startswith((".git/", ".venv", ".ci/", "demo/", "build/")) for name in names)
    assert not any("__pycache__" in name for name in names)


def test_the_version_is_the_same_everywhere():
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    recipe = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    assert f"version: {__version__}\n" in cited
    assert f"version: {__version__}\n" in recipe
    assert f"## {__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_project_has_one_address():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    address = project["urls"]["Source"]
    assert all(one.startswith(address) for one in project["urls"].values())
    assert f"repository-code: {address}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"homepage: {address}\n" in (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    assert address in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_the_recipe_needs_what_the_wheel_needs():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    recipe = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    called = {"typst": "typst-py", "matplotlib": "matplotlib-base"}
    for needed in project["dependencies"]:
        name, _, least = needed.partition(">=")
        assert f"- {called.get(name, name)} >={least}\n" in recipe, needed
