"""Which tests run in continuous integration, and in what order."""

import pytest
from order import slow_first, third


class Item:
    """What `order` looks at of a test."""

    def __init__(self, nodeid, *keywords):
        self.nodeid, self.keywords = nodeid, keywords

    def __repr__(self):
        return self.nodeid


def items():
    """Ten modules of ten tests each; every third holds a slow one."""
    return [
        Item(f"tests/test_{module}.py::test_{k}", *(["slow"] if module % 3 == 0 and k == 5 else []))
        for module in range(10)
        for k in range(10)
    ]


def module(item):
    return item.nodeid.partition("::")[0]


@pytest.mark.parametrize("workers", [2, 3, 4])
def test_every_part_begins_with_slow_modules_and_ends_with_quick_ones(workers):
    tests = items()
    slow_modules = {module(item) for item in tests if "slow" in item.keywords}
    ordered, parts = slow_first(tests, workers), []
    for left in range(workers, 0, -1):  # as pytest-xdist deals them out
        dealt = sum(map(len, parts))
        parts.append(ordered[dealt : dealt + (len(ordered) - dealt) // left])
    assert sorted(ordered, key=repr) == sorted(tests, key=repr)
    for part in parts:
        is_slow = [module(item) in slow_modules for item in part]
        assert is_slow == sorted(is_slow, reverse=True)
        assert is_slow[0]
        assert not is_slow[-1]


def test_modules_stay_whole_and_one_worker_takes_them_as_they_are():
    tests = items()
    ordered = [module(item) for item in slow_first(tests, 2)]
    turns = sum(one != other for one, other in zip(ordered, ordered[1:], strict=False))
    assert turns <= 10  # nine between ten modules, and one where the second worker's part begins
    assert slow_first(tests, 1) == tests


def test_more_slow_modules_than_fit_into_a_part_lose_no_test():
    tests = [Item(f"tests/test_{k}.py::test", "slow") for k in range(5)] + [Item("tests/test_long.py::test")]
    assert set(slow_first(tests, 4)) == set(tests)


def test_a_third_of_the_cases_is_drawn_by_the_text_and_all_else_runs():
    alone, quick = Item("tests/test_a.py::test", "slow"), Item("tests/test_a.py::test_quick")
    cases = [Item(f"tests/test_a.py::test_case[{k}]", "slow") for k in range(9)]
    exams = [Item(f"tests/test_b.py::test_{k}", "slow", "examination") for k in range(7)]
    tests = [alone, quick, *cases, *exams]
    kept = third(tests, "a commit")
    assert {alone, quick} <= kept
    assert len(kept & set(cases)) == 3
    assert len(kept & set(exams)) == 3
    assert kept == third(tests, "a commit")
    drawn = set().union(*(third(tests, str(k)) for k in range(40)))
    assert drawn == set(tests)
