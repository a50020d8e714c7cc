"""A folder of generated files: whole or not at all, and nothing of a user's is lost."""

import json

import pytest

from greybox_id.base.errors import BadInput
from greybox_id.export.verb import MANIFEST, write_folder

FILES = {"car.h": b"header", "sub/car.c": b"source"}


def test_files_and_their_hashes_are_written(tmp_path):
    written = write_folder(tmp_path / "car", FILES, {"target": "c"})
    assert {file.name for file in written} == {"car.h", "car.c", MANIFEST}
    manifest = json.loads((tmp_path / "car" / MANIFEST).read_text())
    assert manifest["target"] == "c"
    assert set(manifest["files"]) == set(FILES)
    assert (tmp_path / "car" / "sub" / "car.c").read_bytes() == b"source"


def test_an_earlier_export_is_replaced_whole(tmp_path):
    write_folder(tmp_path / "car", FILES, {})
    write_folder(tmp_path / "car", {"other.h": b"new"}, {})
    assert {file.name for file in (tmp_path / "car").iterdir()} == {"other.h", MANIFEST}
    assert [file.name for file in tmp_path.iterdir()] == ["car"]


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (lambda folder: (folder / "mine.txt").write_text("notes"), "mine.txt"),
        (lambda folder: (folder / "car.h").write_text("changed"), "car.h"),
        (lambda folder: (folder / MANIFEST).write_text("{}"), "no export"),
        (lambda folder: (folder / MANIFEST).unlink(), "no export"),
    ],
)
def test_what_a_user_put_or_changed_there_is_not_lost(tmp_path, spoil, word):
    folder = tmp_path / "car"
    write_folder(folder, FILES, {})
    spoil(folder)
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    with pytest.raises(BadInput, match=word):
        write_folder(folder, FILES, {})
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before


def test_an_empty_folder_is_taken_and_a_file_is_not(tmp_path):
    (tmp_path / "car").mkdir()
    write_folder(tmp_path / "car", FILES, {})
    (tmp_path / "file").write_text("mine")
    with pytest.raises(BadInput, match="not a folder"):
        write_folder(tmp_path / "file", FILES, {})
    assert (tmp_path / "file").read_text() == "mine"


def test_a_link_is_not_followed(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "mine")
    with pytest.raises(BadInput, match="not a folder"):
        write_folder(tmp_path / "link", FILES, {})


def test_a_place_that_cannot_be_written_is_a_sentence(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(BadInput, match="cannot be written"):
        write_folder(tmp_path / "file" / "car", FILES, {})


def test_numbers_that_are_not_finite_are_written_in_words(tmp_path):
    write_folder(tmp_path / "car", FILES, {"limit": float("inf")})
    assert json.loads((tmp_path / "car" / MANIFEST).read_text())["limit"] == {"not_finite": "inf"}
