"""What is going to be removed works, warns where it is called, and says so in its documentation."""

import pytest

from greybox_id.base.deprecation import deprecated


@deprecated(since="1.1", remove="2.0", use="gb.fit")
def estimate(value: int) -> int:
    """Twice a value."""
    return 2 * value


def test_a_deprecated_function_works_and_warns_at_the_callers_line():
    with pytest.warns(
        DeprecationWarning, match=r"estimate is deprecated since 1.1 and goes with 2.0; use gb.fit\."
    ) as told:
        assert estimate(21) == 42
    assert told[0].filename == __file__


def test_its_documentation_says_it():
    assert estimate.__name__ == "estimate"
    assert estimate.__doc__.startswith("Twice a value.\n\n.. deprecated:: 1.1\n")
