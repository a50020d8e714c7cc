"""What docs/json.md says of `--json`, key by key, and whether what was printed agrees."""

import re

from documents import page


def expanded(path):
    """Paths with one of the names in braces each."""
    found = re.search(r"\{(.*?)\}", path)
    if not found:
        return [path]
    names = [name.strip() for name in found[1].split(",")]
    return [own for name in names for own in expanded(path[: found.start()] + name + path[found.end() :])]


def documented():
    """Section -> its tree of keys: a key as written -> the keys below it."""
    sections = {}
    for title, body in re.findall(r"^## greybox (.*?)\n(.*?)(?=^## |\Z)", page("json.md"), re.MULTILINE | re.DOTALL):
        for command in expanded(title):
            tree = sections.setdefault(command, {})
            for cell in re.findall(r"^\| (`.*?`) \|", body, re.MULTILINE):
                for path in (own for code in re.findall(r"`(.*?)`", cell) for own in expanded(code)):
                    node = tree
                    for key in path.split("."):
                        node = node.setdefault(key, {})
    return sections


PAGE = documented()


def agree(value, tree, where=""):
    """Where value and page differ; keys of the page that are met are marked by None in the tree."""
    if isinstance(value, list):
        for own in value:
            agree(own, tree, where)
        return
    keys = {key.rstrip("?").removesuffix("[]"): key for key in tree if key is not None}
    if not keys or value is None:
        return
    assert isinstance(value, dict), f"{where} has keys in docs/json.md, but is {value!r:.60}"
    (anything,) = [key for key in keys if key.startswith("<")] or [None]
    for name, own in value.items():
        key = keys.get(name, anything)
        assert key is not None, f"{where}.{name} is missing in docs/json.md"
        written_as = keys[key] if key == anything else key
        assert isinstance(own, list) or "[]" not in written_as, f"{where}.{name} is no list"
        tree[written_as][None] = True
        agree(own, tree[written_as], f"{where}.{name}")
    lacking = {name for name, key in keys.items() if not key.endswith("?") and name != anything} - set(value)
    assert not lacking, f"{where} has no {lacking}, which docs/json.md names"


def never_met(tree, where=""):
    """Keys of the page that no call has shown."""
    for key, below in tree.items():
        if key is not None:
            if None not in below:
                yield f"{where}.{key}"
            yield from never_met(below, f"{where}.{key}")
