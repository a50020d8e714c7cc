"""Help is there at once: no library that takes long to load is loaded for it."""

import subprocess
import sys

import pytest

SLOW = ("casadi", "scipy", "pandas", "numba", "matplotlib", "control", "pint")


@pytest.mark.parametrize("words", [["--help"], ["fit", "--help"]])
def test_help_loads_nothing_that_takes_long(words):
    code = (
        "import sys\n"
        "from greybox_id.cli import greybox\n"
        f"greybox.main({words!r}, standalone_mode=False)\n"
        f"print('loaded:', sorted(set({SLOW!r}) & set(sys.modules)))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.splitlines()[-1] == "loaded: []"
