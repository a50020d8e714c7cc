"""A kept result is read back as it was written; anything else is a sentence that says what it is and what to do."""

import json

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.base.json_data import Kind, format_of

KIND = Kind("greybox-lap", 3, "a lap", "greybox lap", "drive again")
BODY = {"name": "Nürburg", "seconds": float("inf"), "rows": [1.0, float("nan")], "version": "9.9"}


def written(folder, text):
    file = folder / "lap.json"
    file.write_text(text, encoding="utf-8")
    return file


def test_what_was_written_comes_back_with_numbers_that_are_not_finite(tmp_path):
    found = KIND.load(written(tmp_path, KIND.text(BODY)), dict)
    assert (found["name"], found["seconds"]) == ("Nürburg", float("inf"))
    np.testing.assert_array_equal(found["rows"], BODY["rows"])


def test_a_file_says_what_it_is(tmp_path):
    assert format_of(written(tmp_path, KIND.text(BODY))) == "greybox-lap"
    assert format_of(written(tmp_path, "[1, 2]")) == ""
    assert format_of(written(tmp_path, "{}")) == ""


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"format": "greybox-fit"}, "is not a lap of greybox-id; make one with greybox lap"),
        ({"format_version": 2}, r"format version 2, .*reads version 3.*wrote it \(9\.9\), or drive again"),
        ({"name": "Spa"}, "does not match its checksum. Restore it, or drive again"),
        ({"more": 1}, "does not match its checksum"),
    ],
)
def test_a_file_that_was_altered_is_a_sentence(tmp_path, change, says):
    body = json.loads(KIND.text(BODY)) | change
    with pytest.raises(BadInput, match=says):
        KIND.load(written(tmp_path, json.dumps(body)), dict)


@pytest.mark.parametrize("error", [KeyError("seconds"), TypeError("a"), ValueError("b"), AttributeError("c")])
def test_content_that_makes_none_is_damage(tmp_path, error):
    def refuse(body):
        raise error

    with pytest.raises(BadInput, match=r"is damaged: .* or drive again"):
        KIND.load(written(tmp_path, KIND.text(BODY)), refuse)
