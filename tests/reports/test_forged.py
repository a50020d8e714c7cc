"""Files of fits that were forged or mended by hand, with a right checksum: each ends in a report or in a sentence."""

import copy
import json
import random

import pytest
from calling import greybox
from driven import driven, written

import greybox_id as gb
from greybox_id.base.errors import GreyboxError
from greybox_id.base.json_data import checksum, read_json
from greybox_id.fitting.saved_fit import load
from greybox_id.models.registry import build
from greybox_id.reports.text.fit import as_dict, parts
from greybox_id.reports.text.screen import as_text

ODD = (
    None, 7, -1, 0, "x", [], {}, True, 1e308, {"not_finite": "nan"}, {"not_finite": "-inf"}, [None], [[1.0]],
    {"x": None},
)  # fmt: skip
GONE = "nothing stands there any more"


@pytest.fixture(scope="module")
def fit(tmp_path_factory):
    folder = tmp_path_factory.mktemp("forged")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GREYBOX_COMPILE", "0")
        laps = [written(driven("lateral", runs=1, seconds=4.0, seed=s), folder / f"lap{s}.csv") for s in (3, 4)]
        called = greybox("fit", "--model", "lateral", "--vehicle", "full_size_car", laps[0], "--validate", laps[1],
                         "--horizon", "1", "--starts", "2", "--out", folder)  # fmt: skip
        assert called.code in (0, 3), called.err  # four seconds are not much of a validation
    return folder / "fit.json"


def places(value, path=()):
    """Everything in plain data, by the way that leads there; of lists the first and the last."""
    yield path
    inside = (
        value if isinstance(value, dict) else {0: 0, len(value) - 1: 0} if isinstance(value, list) and value else {}
    )
    for key in inside:
        yield from places(value[key], (*path, key))


def forged(fit, path, odd):
    """The fit with something odd in one place, and the checksum that goes with it."""
    body = json.loads(fit.read_text())
    del body["checksum"]
    inner = body
    for key in path[:-1]:
        inner = inner[key]
    if odd is GONE:
        del inner[path[-1]]
    else:
        inner[path[-1]] = copy.deepcopy(odd)
    file = fit.with_name("forged.json")
    file.write_text(json.dumps(body))
    body["checksum"] = checksum(read_json(file))
    file.write_text(json.dumps(body))
    return file


def ends_well(file):
    """Whether all is shown of it; else a sentence was said."""
    try:
        found = load(file, build)
        as_dict(found)
        as_text(parts(found))
        gb.report(file, file.with_suffix(".html"))
    except GreyboxError:
        return False
    return True


def drawn(fit, seed, count):
    rng, body = random.Random(seed), json.loads(fit.read_text())
    del body["checksum"]
    known = {key: [path for path in places(body) if path[:1] == (key,)] for key in body}
    for _ in range(count):
        yield rng.choice(known[rng.choice(list(known))]), rng.choice([*ODD, GONE])


def tried(fit, seed, count):
    return [(path, odd, ends_well(forged(fit, path, odd))) for path, odd in drawn(fit, seed, count)]


@pytest.mark.slow
def test_forged_fits_end_in_a_report_or_in_a_sentence(fit):
    assert ends_well(fit)
    found = tried(fit, 1, 10)
    assert any(well for *_, well in found)
    assert not all(well for *_, well in found)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))  # two seconds a page
def test_many_forged_fits_end_in_a_report_or_in_a_sentence(fit, seed):
    tried(fit, 100 + seed, 30)


@pytest.mark.parametrize(
    ("path", "odd"),
    [
        (("metrics", "train", "free run"), {"v_y": {}}),
        (("metrics",), {"train": {"free run": {"v_y": {"rmse": "x"}}}}),
        (("how", "horizon"), "x"), (("how", "robust"), []), (("stages", 0, "noise"), {"v_y": None}),
        (("stages", 0, "starts"), ["x"]), (("data", 0, "samples"), 0), (("data", 0, "path"), 7), (("seed",), "x"),
        (("stages", 0, "certificate"), 7), (("stages", 0, "certificate", "gradient"), "x"), (("command",), None),
        (("per_run",), {"nothing": [1.0]}), (("stages", 0, "history"), [None]),
        (("covariance", "matrix", 0, 0), -1), (("covariance", "matrix", 0, 0), 1e308),
        (("covariance", "matrix", 7, 0), None), (("covariance", "matrix", 7, 7), {"not_finite": "-inf"}),
        (("stages", 0, "starts", 1), {"not_finite": "-inf"}), (("stages",), {}), (("data", 0, "between"), "x"),
        (("metrics", "train", "0.1 s ahead", "v_y", "rmse"), 1e308), (("metrics", "validate", "free run"), {"a": None}),
        (("stages", 0, "ended_at", 1), {"C_f": 1.0}), (("stages", 0, "noise", "v_y"), -1),
        (("parameters", "I_z", "sd"), -1),
    ],
)  # fmt: skip
def test_content_of_another_type_is_a_sentence_that_says_where(fit, path, odd):
    with pytest.raises(GreyboxError, match="is damaged: "):
        load(forged(fit, path, odd), build)
