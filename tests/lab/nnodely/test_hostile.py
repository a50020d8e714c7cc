"""Files that are damaged, edited by hand or made to harm: a sentence, no code run, no hang, bounded memory."""

import json
import os
import random
import sys
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import FOLDER, body_of, imported, said, written

from greybox_id.base.errors import BadInput
from greybox_lab.nnodely import import_network
from greybox_lab.nnodely.network import LONGEST_NAME, MOST_BYTES

SMALL = ("lat_small", "lat_without_a_x", "renamed", "long_by_axle", "full_closed")
LONGEST_SENTENCE = 1_000


def refused(path, inputs=()):
    with pytest.raises(BadInput) as caught:
        import_network(path, inputs)
    assert len(str(caught.value)) < LONGEST_SENTENCE
    return str(caught.value)


def changed(name, **parts):
    body = body_of(name)
    for part, own in parts.items():
        body[part] = body[part] | own
    return body


def nested(depth):
    return '{"Info": ' + "[" * depth + "]" * depth + "}"


def chain(operation, count):
    """A relation that doubles `count` times: as a tree, two to the power of it."""
    links = {f"D{k}": [operation, [f"D{k - 1}"] * 2] for k in range(1, count)}
    return {"D0": ["SamplePart", ["vx"], -1, [-4, 0]], **links}


def lengthened(name, output, count):
    """The file with so many relations between its output and what it was."""
    body = body_of(name)
    before = body["Outputs"][output]
    links = {f"T{k}": ["Tanh", [f"T{k - 1}" if k else before]] for k in range(count)}
    return {**body, "Relations": body["Relations"] | links, "Outputs": {output: f"T{count - 1}"}}


TEXTS = {
    "empty": "",
    "no object": "[1, 2]",
    "truncated": (FOLDER / "lat_small.json").read_text(encoding="utf-8")[:5000],
    "deep": nested(100_000),
    "nan": json.dumps(changed("lat_small", Parameters={"k1_0_0_0": {"dim": [1, 1], "values": [[float("nan")]]}})),
    "infinite": json.dumps(body_of("lat_small")).replace('"SampleTime": 0.05', '"SampleTime": 1e999'),
    "twice": '{"Info": {}, "Info": {}}',
    "long number": '{"Info": ' + "9" * 5000 + "}",
    "other JSON": '{"format": "greybox-fit"}',
    "binary": "\0\1\2",
}
RELATIONS = list(body_of("lat_small")["Relations"])
BODIES = {
    "huge number": changed("lat_small", Parameters={"k1_0_0_0": {"dim": [1, 1], "values": [[1e300]]}}),
    "huge integer": changed("lat_small", Parameters={"k1_0_0_0": {"dim": [1, 1], "values": [[10**4000]]}}),
    "ragged": changed("lat_small", Parameters={"k1_0_0_0": {"dim": [1, 1], "values": [[1, 2], [3]]}}),
    "text for a number": changed("lat_small", Parameters={"k1_0_0_0": {"dim": [1, 1], "values": [["1.0"]]}}),
    "true for a number": changed("lat_small", Parameters={"k1_0_0_0": {"dim": [1, 1], "values": [[True]]}}),
    "many numbers": changed("lat_small", Parameters={"k1_0_0_0": {"dim": 1, "values": [0] * 300_000}}),
    "wrong shape": changed("lat_small", Parameters={"k1_0_0_0": {"dim": 2, "values": [1.0, 2.0]}}),
    "no values": changed("lat_small", Parameters={"k1_0_0_0": {"dim": [1, 1]}}),
    "sample time of nothing": changed("lat_small", Info={"SampleTime": 0}),
    "sample time in words": changed("lat_small", Info={"SampleTime": "0.05"}),
    "a window of a year": json.loads(json.dumps(body_of("lat_small")).replace("[-4, 0]", "[-1000000000, 0]")),
    "many outputs": {**body_of("lat_small"), "Outputs": {str(k): name for k, name in enumerate(RELATIONS)}},
    "no outputs": {**body_of("lat_small"), "Outputs": {}},
    "a law of many relations": lengthened("long_by_axle", "acceleration", 2_000),
    "a sum of many relations": lengthened("lat_small", "yaw_rate_", 2_000),
    "an output that is an input": {**body_of("lat_small"), "Outputs": {"rate": "vx"}},
    "an output that is nowhere": {**body_of("lat_small"), "Outputs": {"rate": "Add1e9"}},
    "an output that is itself": {
        **changed("lat_small", Relations={"A": ["Add", ["A", "A"]]}),
        "Outputs": {"rate": "A"},
    },
    "a name that is a path": {**body_of("lat_small"), "Outputs": {"rate": "../../../etc/passwd"}},
    "a name for a terminal": {**body_of("lat_small"), "Outputs": {"\x1b[2J": "vx"}},
    "a long name": {**body_of("lat_small"), "Outputs": {"a" * (LONGEST_NAME + 1): "vx"}},
    "sums upon sums": {**changed("lat_small", Relations=chain("Add", 60)), "Outputs": {"rate": "D59"}},
    "products upon products": {
        **changed("lat_small", Relations=chain("Mul", 60) | {"F": ["Fir", ["D59"], "PFir1W", None, 0]}),
        "Outputs": {"rate": "F"},
    },
    "an outer product": {
        **changed(
            "lat_small",
            Parameters={"wide": {"dim": 150_000, "values": [[0.0] * 150_000]}},
            Relations={"P": ["SamplePart", ["vx"], -1, [-4, 0]], "L": ["Linear", ["P"], "wide", None, 0]},
        ),
        "Outputs": {"rate": "L"},
    },
    "a name of two things": changed("lat_small", Constants={"vx": {"dim": 1, "values": [1.0]}}),
    "relations that are none": {**body_of("lat_small"), "Relations": {"A": 1, "B": [], "C": ["Add", "AB"]}},
    "a file of lists": {name: [] for name in body_of("lat_small")},
    "an input of many": changed("lat_small", Inputs={"vx": {"dim": 3, "sw": [-4, 0]}}),
}


@pytest.mark.parametrize("kind", TEXTS)
def test_texts_that_are_no_file_of_nnodely_are_a_sentence(tmp_path, kind):
    refused(written(tmp_path, TEXTS[kind]))


@pytest.mark.parametrize("kind", BODIES)
def test_hostile_content_is_a_sentence_in_bounded_memory(tmp_path, kind):
    file = written(tmp_path, BODIES[kind])
    tracemalloc.start()
    sentence = refused(file)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100e6
    assert sentence.isprintable()


def test_files_that_cannot_be_read_are_a_sentence(tmp_path):
    large, folder, pipe = tmp_path / "large.json", tmp_path / "folder.json", tmp_path / "pipe.json"
    with large.open("wb") as opened:
        opened.truncate(1_000_000_000)
    folder.mkdir()
    os.mkfifo(pipe)
    assert f"larger than {MOST_BYTES // 1_000_000} MB" in refused(large)
    assert all(
        "is not a file" in refused(path) for path in (folder, pipe, tmp_path / "nowhere.json", "/dev/zero", "a\0b")
    )
    (tmp_path / "latin.json").write_bytes(b'{"Info": "\xff"}')
    assert "not JSON" in refused(tmp_path / "latin.json")


RAN: set[str] = set()
"""What was executed, imported or opened while `WATCHED`; such a hook cannot be taken away again."""
WATCHED = {"on": False}


def _hook(event, arguments):
    if WATCHED["on"] and event in ("exec", "import", "open", "os.system", "subprocess.Popen", "socket.connect"):
        code = arguments[0]
        RAN.add(f"{event} {(code.co_names, code.co_consts) if event == 'exec' else code!r}")


def ran_with(file):
    """What runs while a file is read; evaluating type hints of our own settings counts too."""
    RAN.clear()
    WATCHED["on"] = True
    try:
        import_network(file)
    except BadInput:
        pass
    finally:
        WATCHED["on"] = False
    return {event for event in RAN if event != f"open {str(file)!r}"}


CANARY = "__import__('pathlib').Path({!r}).touch()"


@pytest.mark.parametrize("name", ["lat_small", "long_by_axle", pytest.param("full_closed", marks=pytest.mark.slow)])
def test_no_text_of_a_file_is_ever_executed(tmp_path, name):
    sys.addaudithook(_hook)
    import_network(FOLDER / f"{name}.json")  # what is imported late is imported now
    usual = ran_with(FOLDER / f"{name}.json")
    canary = CANARY.format(str(tmp_path / "ran"))
    tried = [ran_with(written(tmp_path, body)) for body in _poisoned(body_of(name), canary)]
    assert len(tried) > 40
    assert set().union(*tried) <= usual
    assert not (tmp_path / "ran").exists()


def test_the_watch_on_what_is_executed_sees_what_is(tmp_path, monkeypatch):
    sys.addaudithook(_hook)
    monkeypatch.setattr("greybox_lab.nnodely.verb.read_network", lambda path: eval("canary", {"canary": path}))
    with pytest.raises(AttributeError):
        ran_with(FOLDER / "lat_small.json")
    assert any("canary" in event for event in RAN)


def _poisoned(body, canary):
    """The file with code in place of each text that is code, and of others of each kind."""
    for name, own in body["Functions"].items():
        for key in ("code", "functions", "names", "name", "params_and_consts"):
            if key in own:
                for code in (canary, f"def {own.get('name', 'f')}(x={canary}):\n  return x\n", f"{canary}\n{own[key]}"):
                    yield {**body, "Functions": {**body["Functions"], name: {**own, key: code}}}
    for name, own in list(body["Parameters"].items())[:3]:
        yield {**body, "Parameters": {**body["Parameters"], name: {**own, "init_fun": {"code": canary, "name": "f"}}}}
        yield {**body, "Parameters": {**body["Parameters"], name: {**own, "values": canary}}}
    seen = set()
    for name, own in body["Relations"].items():
        if own[0] not in seen:
            seen.add(own[0])
            for place in range(len(own)):
                yield {**body, "Relations": {**body["Relations"], name: [*own[:place], canary, *own[place + 1 :]]}}
    for part in body:
        yield {**body, part: canary}
        yield {**body, part: {canary: canary}}


ODD = (
    *(
        None,
        True,
        -1,
        0,
        1,
        2,
        10**30,
        10**4000,
        1e300,
        -1e300,
        0.5,
        "",
        "x",
        [],
        {},
        [[]],
        [[[[1]]]],
        "vx",
        [0, 1],
        [-1, 0],
    ),
    *([-(10**9), 0], {"a": 1}, "Fir", "Mul", "Add", "Fuzzify", "ParamFun", "Identity", CANARY, "../../etc/passwd"),
)
SNIPPETS = ("(", "*", "torch.", "__import__('os')", ":", "1e999", "~", " ", "v", "0", "\x1b")


def places(value, path=()):
    """Paths to everything in plain data."""
    yield path
    if isinstance(value, (dict, list)):
        for key, own in value.items() if isinstance(value, dict) else enumerate(value):
            yield from places(own, (*path, key))


def mutated(body, rng: random.Random):
    """Plain data with one to three things deleted, replaced, doubled, renamed or moved."""
    paths = [path for path in places(body) if path]
    names = [path[-1] for path in paths if isinstance(path[-1], str)]
    for _ in range(rng.randint(1, 3)):
        path, other = rng.choice(paths), rng.choice(paths)
        try:
            *into, key = path
            own, moved = _at(body, into), _at(body, other)
            old = own[key]
        except (KeyError, IndexError, TypeError):
            continue  # an earlier change took it away
        how = rng.randrange(6)
        if not isinstance(own, (dict, list)):
            continue
        if how == 0:
            del own[key]
        elif how == 1 and isinstance(own, list):
            own.append(old)
        elif how == 2:
            own[key] = rng.choice(names)
        elif how == 3:
            own[key] = json.loads(json.dumps(moved))
        elif how == 4 and isinstance(old, str) and old:
            place = rng.randrange(len(old))
            own[key] = old[:place] + rng.choice(SNIPPETS) + old[place + rng.randrange(3) :]
        else:
            own[key] = rng.choice(ODD)
    return body


def _at(value, path):
    for key in path:
        value = value[key]
    return value


def _survives(rng: random.Random, folder) -> None:
    name = rng.choice(SMALL)
    if rng.random() < 0.2:
        text = (FOLDER / f"{name}.json").read_text(encoding="utf-8")
        place = rng.randrange(len(text))
        content = text[:place] + ("" if rng.random() < 0.3 else rng.choice('0123456789.eE-"[]{},x') + text[place + 1 :])
    else:
        content = mutated(body_of(name), rng)
    try:
        found = imported(folder, content, said(name))
    except BadInput as error:
        assert len(str(error)) < LONGEST_SENTENCE  # noqa: PT017 - both ends are good ones
    else:
        assert np.all(np.isfinite(found.fit.model.values))
        assert found.error <= 1e-9


@settings(max_examples=40)
@given(st.integers(0, 2**32))
def test_a_changed_file_is_a_model_that_predicts_as_its_graph_does_or_a_sentence(tmp_path, seed):
    _survives(random.Random(seed), tmp_path)


@pytest.mark.examination
@pytest.mark.slow
@settings(max_examples=2000)
@given(st.integers(0, 2**32))
def test_two_thousand_changed_files_are_models_or_sentences(tmp_path, seed):
    _survives(random.Random(seed), tmp_path)
