"""YAML of strangers: plain data or a sentence."""

import time

import pytest
from calling import refused

from greybox_id.base.errors import BadInput
from greybox_lab.nnodely.vehicles import parse_yaml, read_yaml

HOSTILE = {
    "object": "!!python/object/apply:os.system ['true']",
    "tag": "m: !!float 3",
    "alias": "a: &a [1, 2]\nb: *a",
    "laughs": "a: &a [x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nd: [*c, *c]",
    "merge": "a: &a {m: 1}\nb:\n  <<: *a",
    "deep": "[" * 3000,
    "deep tables": "".join(f"{' ' * k}a:\n" for k in range(60)),
    "many": "\n".join(f"k{k}: 1" for k in range(30_000)),
    "twice": "m: 1\nm: 2",
    "no text": "m: \x00",
    "tab": "m:\n\t- 1",
    "open": "m: [1, 2",
    "date": "m: 2024-99-99",
    "key": "? [1, 2]\n: 3",
    "documents": "a: 1\n---\nb: 2",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_texts_end_in_a_sentence_at_once(name, tmp_path):
    begun = time.process_time()
    with pytest.raises(BadInput, match=r"x\.yaml"):
        parse_yaml(HOSTILE[name], "x.yaml")
    assert time.process_time() - begun < 20
    (tmp_path / "x.yaml").write_text(HOSTILE[name])
    assert "x.yaml" in refused("import", tmp_path / "x.yaml", "--out", tmp_path / "car.toml")
    assert not (tmp_path / "car.toml").exists()


def test_a_file_that_is_too_large_or_no_text_is_a_sentence(tmp_path):
    (tmp_path / "x.yaml").write_bytes(b"a" * 2_000_000)
    with pytest.raises(BadInput, match="larger than 1 MB"):
        read_yaml(tmp_path / "x.yaml")
    (tmp_path / "x.yaml").write_bytes(b"\xff\xfe")
    with pytest.raises(BadInput, match="UTF-8"):
        read_yaml(tmp_path / "x.yaml")
    with pytest.raises(BadInput, match="cannot be read"):
        read_yaml(tmp_path / "none.yaml")


def test_plain_data_is_read():
    assert parse_yaml("m: 1.5\nlist: [1, 2]\ntext: 'a'", "x") == {"m": 1.5, "list": [1, 2], "text": "a"}


def test_without_pyyaml_the_extra_is_named(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "yaml", None)
    with pytest.raises(BadInput, match=r"pip install 'greybox-id\[yaml\]'"):
        parse_yaml("m: 1", "x")
