"""What `import greybox_id as gb` offers: named, documented, with examples that run."""

import ast
import doctest
import inspect
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import matplotlib as mpl
import pytest

import greybox_id as gb

NAMES = tuple(gb.__all__)


@pytest.fixture(autouse=True)
def _without_a_screen():
    mpl.use("Agg")


def test_the_top_level_is_a_table_of_contents():
    assert len(NAMES) <= 30
    assert set(NAMES) < set(dir(gb))


def test_editors_see_what_is_loaded_on_demand():
    body = ast.parse(Path(gb.__file__).read_text(encoding="utf-8")).body
    shown = next(node for node in body if isinstance(node, ast.If)).body
    seen = {}
    for node in shown:
        if isinstance(node, ast.ImportFrom):
            seen |= {name.asname or name.name: (node.module, name.name) for name in node.names}
        else:
            seen[node.targets[0].id] = seen.pop(node.value.id)
    places = {name: place.partition(":") for name, place in gb._PLACES.items()}
    assert seen == {
        name: (module, inside) if inside else (module.rpartition(".")[0] or None, name)
        for name, (module, _, inside) in places.items()
    }


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name == "design" else name for name in NAMES]
)
def test_every_name_is_documented_with_an_example_that_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    thing = getattr(gb, name)
    module = thing if isinstance(thing, ModuleType) else import_module(thing.__module__)
    tests = [own for own in doctest.DocTestFinder().find(thing, name, module=module, globs={}) if own.examples]
    assert name in [test.name for test in tests]
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    for test in tests:
        runner.run(test)
    assert runner.failures == 0


@pytest.mark.parametrize("name", [own for own in NAMES if inspect.isfunction(getattr(gb, own))])
def test_every_argument_of_a_verb_is_documented(name):
    verb = getattr(gb, name)
    text = inspect.getdoc(verb)
    sections = text.partition("Parameters\n")[2].partition("\n\n")[0]
    for argument in inspect.signature(verb).parameters:
        assert argument in sections, f"{name}: {argument}"
    if inspect.signature(verb).parameters:
        assert "Raises\n------" in text


LAP = "lap = gb.read(gb.datasets.shipped('racer_train'), columns='roboracer').rows(0, 200);"
HELP = "from greybox_id.cli import main; sys.argv = ['greybox', {}]\ntry: main()\nexcept SystemExit: pass\n"


@pytest.mark.parametrize(
    ("code", "unneeded"),
    [
        ("import greybox_id as gb;", "casadi numpy pandas scipy click"),
        (HELP.format("'--help'"), "numpy rich multiprocessing concurrent difflib hashlib ctypes casadi scipy pandas"),
        (HELP.format("'fit', '--help'"), "casadi scipy pandas numba matplotlib control pint"),
        (f"import greybox_id as gb; {LAP} gb.check(lap);", "casadi numba pint scipy"),
        (
            f"import greybox_id as gb; {LAP} gb.fit('kinematic', lap, vehicle='roboracer', "
            "options=gb.FitOptions(solver='gauss-newton')).summary();",
            "numba matplotlib control",
        ),
    ],
)
def test_what_is_not_needed_is_not_loaded(code, unneeded):
    loaded = f"import sys; {code}print({{own.split('.')[0] for own in sys.modules}} & {set(unneeded.split())})"
    found = subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True, check=True)
    assert found.stdout.splitlines()[-1] == "set()"


def test_verbs_keep_their_names_when_modules_of_the_same_name_are_imported():
    code = (
        "import greybox_id as gb; import greybox_id.fitting.fit, greybox_id.export.verb, greybox_id.models.registry;"
        "from greybox_id.fitting.fit import Fit; from greybox_id.export import subject;"
        "assert callable(gb.fit) and callable(gb.export) and callable(gb.models.single_track);"
        "assert issubclass(gb.Fit, Fit)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_names_that_moved_into_a_room_are_had_from_the_top_with_a_warning():
    for name in gb._MOVED:
        with pytest.warns(DeprecationWarning, match=rf"gb\.{name} is (gb|greybox_id)\..+ now"):
            assert getattr(gb, name) is not None
    with pytest.warns(DeprecationWarning, match=r"gb\.models\.Parameter"):
        assert gb.Parameter is gb.models.Parameter


def test_a_name_that_is_not_there_is_said_with_the_nearest():
    with pytest.raises(AttributeError, match="Did you mean diagnose"):
        gb.diagnos  # noqa: B018
