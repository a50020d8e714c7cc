"""What is wrong with fleet.toml is said before anything is done."""

import pytest

from greybox_id.base.errors import BadInput
from greybox_lab.fleet.plan import plan_of

GOOD = 'recordings = "*.csv"\nvehicle = "full_size_car"\n'
FIT = '[fit]\nmodel = "lateral"\n'


def of(folder, text):
    (folder / "fleet.toml").write_text(text, encoding="utf-8")
    return plan_of(folder / "fleet.toml")


def test_what_is_not_said_has_a_default(tmp_path):
    plan = of(tmp_path, GOOD + FIT)
    assert plan.steps == ("check", "fit")
    assert (plan.seconds, plan.memory, plan.columns) == (120.0, 1e9, "canonical")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("recordings = [", "not valid TOML"),
        ('recording = "*.csv"', 'there is no key "recording". Did you mean recordings?'),
        ("", "names no recordings"),
        ("recordings = 3\n", "recordings is a pattern"),
        (GOOD + 'columns = "nix.toml"\n' + FIT, "columns = 'nix.toml' cannot be used"),
        (GOOD + 'steps = ["chek"]\n' + FIT, "there is no step 'chek'. Did you mean check?"),
        (GOOD + '[fit]\nmodel = "laterl"\n', "Did you mean lateral?"),
        (GOOD + FIT + "horizn = 2\n", "no option 'horizn'. Did you mean horizon?"),
        (GOOD + FIT + "horizon = -2\n", "seconds above zero"),
        (GOOD + FIT + 'with = ["own.py:effect"]\n', "cannot name code to run"),
        (GOOD + FIT + 'fix = ["mass=3"]\n', "has no parameter mass"),
        (GOOD + "limits = {seconds = 0}\n" + FIT, "limits.seconds is a number above zero"),
        (GOOD + 'limits = {memory = "lots"}\n' + FIT, "limits.memory is a size"),
        (GOOD + "limits = {hours = 2}\n" + FIT, "limits is a table"),
        ('recordings = "*.csv"\nvehicle = "nope.toml"\n' + FIT, "nope.toml"),
        ('recordings = "*.csv"\nsteps = ["gap"]\n', "compares with a vehicle's simulation"),
    ],
)
def test_what_is_wrong_is_a_sentence(tmp_path, text, said):
    with pytest.raises(BadInput) as error:
        of(tmp_path, text)
    assert said in str(error.value)
    assert str(tmp_path / "fleet.toml") in str(error.value)


def test_a_missing_file_is_a_sentence(tmp_path):
    with pytest.raises(BadInput, match="No such file"):
        plan_of(tmp_path / "fleet.toml")


@pytest.mark.parametrize(("text", "size"), [("1GB", 1e9), ("512 MiB", 2.0**29), ("200MB", 2e8)])
def test_sizes_have_units(tmp_path, text, size):
    assert of(tmp_path, GOOD + f'limits = {{memory = "{text}"}}\n' + FIT).memory == size


def test_the_key_follows_from_options_but_not_from_limits(tmp_path):
    one = of(tmp_path, GOOD + FIT).computing
    assert of(tmp_path, GOOD + "limits = {seconds = 5}\n" + FIT).computing == one
    assert of(tmp_path, GOOD + FIT + "horizon = 2.0\n").computing != one
