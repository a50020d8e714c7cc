"""Functions in machine code: compiled once, by another process, so that Ctrl-C is heard meanwhile."""

import importlib.util
import os
import sys

import numba
import pytest
from numba import njit

from greybox_id.base import machine_code, processes

SOURCE = """
import numpy as np
from greybox_id.base.machine_code import begun, compiled

@compiled
def inverse(x):
    return 1.0 / x

@begun
def total(values):
    found = 0.0
    for own in values:
        found += inverse(own)
    return found
"""


@pytest.fixture
def imported(monkeypatch):
    """A file -> its module, imported anew; Numba looks for it among those that are."""

    def module(file):
        spec = importlib.util.spec_from_file_location("functions", file)
        found = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "functions", found)
        spec.loader.exec_module(found)
        return found

    return module


@pytest.fixture
def forks(monkeypatch):
    counted = []

    def counting(work):
        counted.append(work)
        return processes.elsewhere(work)

    monkeypatch.setattr(machine_code, "elsewhere", counting)
    return counted


@pytest.mark.skipif(not processes.FORKS, reason="processes are not forked here")
def test_a_function_is_compiled_once_and_elsewhere(tmp_path, forks, imported):
    file = tmp_path / "functions.py"
    file.write_text(SOURCE)
    os.utime(file, (1e9, 1e9))
    first = imported(file)
    assert first.total((2.0, 4.0)) == 0.75
    assert first.total((2.0, 4.0)) == 0.75
    assert len(forks) == 1
    assert imported(file).total((2.0, 4.0)) == 0.75
    assert len(forks) == 1


@pytest.mark.skipif(not processes.FORKS, reason="processes are not forked here")
def test_it_is_compiled_again_where_its_file_changed(tmp_path, forks, imported):
    file = tmp_path / "functions.py"
    file.write_text(SOURCE)
    os.utime(file, (1e9, 1e9))
    assert imported(file).total((2.0, 4.0)) == 0.75
    file.write_text(SOURCE.replace("1.0 / x", "2.0 / x"))
    assert imported(file).total((2.0, 4.0)) == 1.5
    assert len(forks) == 2


def test_division_by_zero_is_infinite(tmp_path, imported):
    file = tmp_path / "functions.py"
    file.write_text(SOURCE)
    assert imported(file).total((0.0,)) == float("inf")


def test_where_nothing_can_be_kept_it_is_compiled_here(monkeypatch, forks):
    def no_folder(**how):
        if how.get("cache"):
            raise RuntimeError("cannot cache function: no locator available")
        return njit(**how)

    monkeypatch.setattr(numba, "njit", no_folder)
    assert machine_code.begun(lambda x: 2 * x)(4) == 8
    assert forks == []
