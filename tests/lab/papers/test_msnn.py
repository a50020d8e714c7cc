"""The paper's tables: its figures, its loss, and sentences where recordings are not there."""

import numpy as np
import pytest
from calling import refused
from toys import drive

from greybox_id.base.errors import BadInput
from greybox_id.fitting.adaptation.verb import adapt
from greybox_id.fitting.grid import fit_grid
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.scores.memory import errors, predictions
from greybox_id.fitting.verb import fit
from greybox_id.models.registry import build, prepared
from greybox_lab.papers.bench import pages_of, write_pages
from greybox_lab.papers.msnn import ENTRIES, PAPER, MsnnBench, as_the_authors, compared, measure
from greybox_lab.papers.msnn_figures import WHEELBASE, quasi_steady
from greybox_lab.papers.msnn_report import msnn_report

SIZES = {"gnn": 528, "msnn_bench_lat": 41, "msnn_bench_long": 34}


def test_every_row_of_tables_1_and_2_has_its_published_figure():
    asked = {
        (entry.name, output, share, split)
        for entry in ENTRIES
        for output in entry.tables
        for share in entry.shares
        for split in ("train", "valid")
        if not (entry.model == "gnn" and output == "a_x" and share < 100)
    }
    assert asked == set(PAPER)


def test_entries_are_the_papers_structures():
    sizes = {(entry.name, entry.model): build(entry.model, dict(entry.settings)).size for entry in ENTRIES}
    assert sizes["Ablation 1", "msnn_lat"] == 120
    assert sizes["Ablation 2", "msnn_lat"] == 70
    assert sizes["Ablation 3", "msnn_long"] == 346
    assert {model: size for (_, model), size in sizes.items() if model in SIZES} == SIZES


def test_the_authors_loss_is_lowered_where_batches_differ_in_noise():
    """Least squares are ruled by the noisy batches; the mean of the batches' root mean squares is not."""
    train = drive(1220)
    rng = np.random.default_rng(0)
    loud = np.where(np.arange(1220) // 100 % 2, 0.02, 1.0)
    train = train.with_signals(yaw_rate=train["yaw_rate"] + loud * rng.standard_normal(1220))
    model = prepared("msnn_bench_lat", train, {"q": 4})
    own = as_the_authors(model, train, train)
    plain = fit(model, [train], how=FitOptions(strengths=0.5, solver="gauss-newton")).model
    loss = [errors(m, predictions(m, train, "published"), "published")["yaw_rate"].rmse for m in (own, plain)]
    assert loss[0] < loss[1]


def test_recordings_that_are_not_there_are_named(tmp_path):
    assert "not a folder" in refused("bench", "msnn", "--data", tmp_path / "nowhere")
    assert "train.csv" in refused("bench", "msnn", "--data", tmp_path)
    with pytest.raises(BadInput, match="not a folder"):
        measure(tmp_path / "nowhere")


@pytest.fixture(scope="module")
def found():
    """All that a report shows, of small networks on a made-up car."""
    train, valid = drive(700, 1), drive(500, 2)
    small = {
        ("MS-NN-full", "msnn_lat"): {"n_delta": 3, "q": 4}, ("MS-NN-full", "msnn_long"): {"eta": 2, "gamma": 4},
        ("MS-NN-bench", "msnn_bench_lat"): {"q": 4}, ("MS-NN-bench", "msnn_bench_long"): {},
        ("G-NN", "gnn"): {"neurons": 2, "gamma": 4},
    }  # fmt: skip
    how = FitOptions(strengths=1.0, solver="gauss-newton")
    fits = {key: fit(prepared(key[1], train, own), [train], how=how) for key, own in small.items()}
    car = drive(600, 3)
    adapted = {("single_mass", kind): adapt(own, car, trained=[train]) for (_, kind), own in fits.items()}
    varied = {"msnn_lat": {"n_delta": (3,), "q": (4,), "n_v": (1, 2)}, "msnn_long": {"eta": (2,), "gamma": (4,)}}
    grids = {name: fit_grid(name, train, own, validate=valid, strength=1.0) for name, own in varied.items()}
    told = {"rmse": 0.1, "stderr": 0.01, "fvu": 0.02, "parameters": 3, "cpu_seconds": 0.5, "share": 100, "paper": 0.2,
            "paper_fvu": None, "output": "yaw_rate"}  # fmt: skip
    rows = [told | {"table": table, "model": "MS-NN-full", "split": split, "protocol": protocol}
            for table, split in ((1, "valid"), (2, "valid"), (3, "single_mass, zero-shot"), ("coupled", "valid"))
            for protocol in ("published", "honest")]  # fmt: skip
    rows += [told | {"table": 3, "model": "MS-NN-full", "rmse": 0.07, "split": f"single_mass, {what}", "protocol": own}
             for what, own in (("fine-tuned in sample", "published"), ("adapted to 20 s", "honest"))]  # fmt: skip
    return MsnnBench(rows, compared(fits, valid), fits, adapted, grids, train, valid, {"single_mass": car}, quick=True)


def test_models_are_compared_at_the_same_rows(found):
    assert {(own["output"], own["model"]) for own in found.comparisons} == {
        ("yaw_rate", "MS-NN-bench"), ("yaw_rate", "G-NN"), ("a_x", "MS-NN-bench"), ("a_x", "G-NN"),
    }  # fmt: skip
    for own in found.comparisons:
        assert own["low"] <= own["difference"] <= own["high"]
        assert own["distinguished"] == (own["low"] > 0 or own["high"] < 0)


@pytest.mark.slow
def test_the_report_holds_tables_and_figures_beside_the_papers(found, tmp_path):
    page, paper = write_pages(msnn_report(found), pages_of(tmp_path, "msnn"), "greybox bench msnn")
    text = page.read_text(encoding="utf-8")
    for words in ("Table 1", "Table 2", "Table 3", "0.200", "0.100 (0.020)", "0.100 ± 0.010", "yaw rate"):
        assert words in text
    for before_and_after in ("0.200 → 0.200", "0.100 (0.020) → 0.070 (0.020)", "0.100 ± 0.010 → 0.070 ± 0.010"):
        assert text.count(before_and_after) == 1
    names = [own.name for own in msnn_report(found).drawings]
    assert names == ["fig_2", "fig_7", "fig_8", "fig_9", "fig_10", "fig_10d", "fig_11", "fig_12_single_mass"]
    assert text.count("<svg") == len(names)
    assert paper.read_bytes().startswith(b"%PDF")


def test_quasi_steady_samples_are_those_of_steady_turns():
    """On a circle at constant speed everything counts, and the handling diagram is a point."""
    recording = drive(400)
    R, v = 2.0, 1.5
    steady = recording.with_signals(
        v_x=np.full(400, v), yaw_rate=np.full(400, v / R) + 1e-3 * np.sin(np.arange(400) / 9.0),
        steer=np.full(400, 0.2),
    )  # fmt: skip
    a_y, beyond = quasi_steady(steady.with_signals(v_x=v + 1e-3 * np.sin(np.arange(400) / 7.0)))
    inner = slice(5, -5)
    assert len(a_y) > 5
    np.testing.assert_allclose(a_y[inner], v**2 / R, rtol=0.01)
    np.testing.assert_allclose(beyond[inner], 0.2 - WHEELBASE / R, atol=0.002)
