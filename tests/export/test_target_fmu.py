"""Functional mock-up units: valid, driven as we simulate, clean under sanitizers, the same bytes every time."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import casadi as cs
import numpy as np
import pytest
from compiled import needed, run
from lxml import etree

from greybox_id.export.equations import Equations
from greybox_id.export.fmu.description import steps_of
from greybox_id.export.subject import Subject
from greybox_id.export.target_fmu import VERSIONS, files
from greybox_id.fitting.fit import Fit
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

fmpy = pytest.importorskip("fmpy", reason="fmpy is not installed: pip install fmpy")
from fmpy.validation import validate_fmu  # noqa: E402
from units_driven import MINUTE, SETS, VEHICLES, Unit, driven, made, simulated  # noqa: E402

HARNESS = Path(__file__).with_name("harness")

FMUS = ("car.fmu", "car_fmi3.fmu")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
BUSY = {**SETS["actuators"], **SETS["sensors"], "tyre_relaxation": 0.3}


@pytest.fixture(scope="module")
def busy(tmp_path_factory):
    needed("gcc")
    return made(tmp_path_factory.mktemp("busy") / "car", "full_size_car", BUSY)


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    needed("gcc")
    return made(tmp_path_factory.mktemp("bare") / "car", "full_size_car", {})


def fit_of(model):
    """A fit of a model whose free parameters are known to a twentieth."""
    sd = {p.name: 0.05 * np.abs(p.array) for p in model.parameters if not p.fixed}
    return Fit(model=model, sd=sd, stages=(), metrics={}, data=(), mode="given", seed=0)


def close(found, ours):
    """Relative to each output's largest, over a minute; where we read nothing yet, nothing is compared."""
    off = np.abs(found - ours)[:MINUTE] / np.nanmax(np.abs(ours), axis=0)
    assert np.nanmax(off) <= 1e-9
    assert np.mean(np.isnan(ours)) < 0.01


@pytest.mark.parametrize("file", FMUS)
@pytest.mark.parametrize("which", ["busy", "bare"])
def test_fmpy_finds_nothing_to_say(request, which, file):
    assert validate_fmu(str(request.getfixturevalue(which)[1] / file)) == []


@pytest.mark.parametrize("file", FMUS)
def test_a_minute_is_as_we_simulate_it(tmp_path, file):
    model, folder = made(tmp_path / "car", "full_size_car", SETS["actuators"])
    drive = driven("full_size_car", model)
    unit = Unit(folder / file, tmp_path / "unit")
    close(unit.run(*drive), simulated(model, *drive))
    unit.close()


@pytest.mark.slow
@pytest.mark.parametrize("effects", SETS)
@pytest.mark.parametrize("name", VEHICLES)
def test_vehicles_and_effects_go_for_a_minute_as_we_simulate_them(tmp_path, name, effects):
    model, folder = made(tmp_path / "car", name, SETS[effects])
    drive = driven(name, model)
    ours = simulated(model, *drive)
    for file in FMUS:
        unit = Unit(folder / file, tmp_path / "unit")
        close(unit.run(*drive), ours)
        unit.close()


def test_fmpy_simulates_it(bare):
    model, folder = bare
    t, steering, drive, start = driven("full_size_car", model, 501)
    signals = np.array(
        list(zip(t, steering, drive, strict=True)), dtype=[("time", float), ("steer", float), ("drive", float)]
    )
    ours = simulated(model, t, steering, drive, start)
    begin = {f"state.{name}": value for name, value in start.items()}
    for file in FMUS:
        asked = {"stop_time": t[-1], "output_interval": 0.01, "input": signals, "start_values": begin}
        found = fmpy.simulate_fmu(
            str(folder / file), **asked, step_size=0.01, fmi_type="CoSimulation", output=["v_x", "v_y", "yaw_rate"]
        )
        for name in ("v_x", "v_y", "yaw_rate"):
            own = ours[:, model.outputs.index(name)]
            np.testing.assert_allclose(found[name], own, atol=1e-9 * np.max(np.abs(own)), rtol=0)


@pytest.mark.parametrize("file", FMUS)
def test_a_differential_equation_is_offered_to_other_integrators(bare, file):
    _, folder = bare
    asked = {"stop_time": 3.0, "start_values": {"state.v_x": 15.0, "steer": 0.03}, "output": ["v_x", "yaw_rate"]}
    exchanged = fmpy.simulate_fmu(str(folder / file), fmi_type="ModelExchange", relative_tolerance=1e-9, **asked)
    stepped = fmpy.simulate_fmu(str(folder / file), fmi_type="CoSimulation", output_interval=0.001, **asked)
    np.testing.assert_allclose(exchanged["v_x"][-1], stepped["v_x"][-1], rtol=1e-6)
    np.testing.assert_allclose(exchanged["yaw_rate"][-1], stepped["yaw_rate"][-1], rtol=1e-5)


def test_models_with_actuators_offer_no_model_exchange(busy):
    for file in FMUS:
        assert fmpy.read_model_description(str(busy[1] / file)).modelExchange is None


def test_parameters_can_be_set_and_act(bare, tmp_path):
    _, folder = bare
    turned = []
    for mass in (1457.2, 3000.0):
        unit = Unit(folder / "car.fmu", tmp_path / "unit")
        unit.begin(state__v_x=15.0, steer=0.03, parameters__m=mass)
        unit.step(0.0, 1.0)
        turned += unit.get("v_y", "parameters.m")
        unit.close()
    assert (turned[1], turned[3]) == (1457.2, 3000.0)
    assert abs(turned[0] - turned[2]) > 1e-3


def test_a_state_is_kept_serialised_and_taken_up_again(busy, tmp_path):
    unit = Unit(busy[1] / "car.fmu", tmp_path / "unit")
    unit.begin(state__v_x=15.0, steer=0.03)
    for k in range(30):
        unit.step(k * 0.01, 0.01)
    kept = unit.fmu.getFMUstate()
    saved = unit.fmu.serializeFMUstate(kept)
    unit.set(steer=-0.05)
    unit.step(0.3, 0.01)
    unit.step(0.31, 0.01)
    first = unit.get()
    unit.fmu.setFMUstate(unit.fmu.deSerializeFMUstate(saved))
    unit.set(steer=-0.05)
    unit.step(0.3, 0.01)
    unit.step(0.31, 0.01)
    assert unit.get() == first
    unit.fmu.freeFMUstate(kept)
    unit.close()


@pytest.mark.parametrize("file", FMUS)
def test_directional_derivatives_are_those_of_the_equations(bare, tmp_path, file):
    model, folder = bare
    e = Equations(model)
    unit = Unit(folder / file, tmp_path / "unit")
    x, u = [12.0, 0.3, 0.2], [0.04, 0.5]
    unit.begin(state__v_x=x[0], state__v_y=x[1], state__yaw_rate=x[2], steer=u[0], drive=u[1])
    known = [unit.references[name] for name in ("state.v_x", "state.v_y", "state.yaw_rate", "steer", "drive")]
    by = [0.3, -0.2, 0.1, 0.05, -0.4]
    for of, names in (
        (e.output, unit.outputs),
        (e.ode, [f"der(state.{state.name})" for state in e.states]),
    ):
        value = of(e.x, e.u, e.p)
        slope = cs.Function("slope", [e.x, e.u, e.p], [cs.jtimes(value, cs.vertcat(e.x), cs.DM(by[:3]))])
        aside = cs.Function("aside", [e.x, e.u, e.p], [cs.jtimes(value, e.u, cs.DM(by[3:]))])
        true = np.array(slope(x, u, e.values) + aside(x, u, e.values)).ravel()
        unknown = [unit.references[name] for name in names]
        np.testing.assert_allclose(unit.fmu.getDirectionalDerivative(unknown, known, by), true, rtol=1e-10, atol=1e-12)
    unit.close()


def test_what_waits_for_a_delay_does_not_move_with_its_command(busy, tmp_path):
    unit = Unit(busy[1] / "car.fmu", tmp_path / "unit")
    unit.begin(state__v_x=15.0, steer=0.0)
    unit.step(0.0, 0.01)
    wheel, lateral = unit.references["steer"], unit.references["v_y"]
    assert unit.fmu.getDirectionalDerivative([lateral], [wheel], [1.0]) == [0.0]
    unit.close()


def test_wrong_requests_are_refused_and_said(busy, tmp_path):
    unit = Unit(busy[1] / "car.fmu", tmp_path / "unit")
    unit.begin(state__v_x=15.0)
    with pytest.raises(Exception, match="status 3"):
        unit.set(steer=float("nan"))
    for time, length in ((0.0, -0.01), (0.0, float("nan")), (0.5, 0.01), (0.0, float("inf"))):
        with pytest.raises(Exception, match="status 3"):
            unit.step(time, length)
    with pytest.raises(Exception, match="status 2"):
        unit.step(0.0, 1e9)
    unit.step(0.0, 0.01)
    unit.close()


def test_units_and_intervals_are_in_the_description(tmp_path):
    needed("gcc")
    model = build("single_track", {}, {}, vehicle("full_size_car"))
    free = [p.name for p in model.parameters if not p.fixed]
    fit = fit_of(model)
    held = files(Subject(model, "car", tuple(free), fit, source="a test"))
    for file, place in (("car.fmu", "Tool"), ("car_fmi3.fmu", "Annotation")):
        (tmp_path / file).write_bytes(held[file])
        units = {
            definition.name: definition.baseUnit
            for definition in fmpy.read_model_description(str(tmp_path / file)).unitDefinitions
        }
        assert (units["kg m^2"].kg, units["kg m^2"].m, units["kg m^2"].s) == (1, 2, 0)
        assert units["N/unit"] is None
        with zipfile.ZipFile(tmp_path / file) as opened:
            tree = etree.fromstring(opened.read("modelDescription.xml"))
        (interval,) = tree.xpath(f"//*[@name='parameters.I_z']//{place}/Interval")
        low, high = fit.interval("I_z")
        assert (float(interval.get("low")), float(interval.get("high"))) == (float(low), float(high))
        assert validate_fmu(str(tmp_path / file)) == []


def test_the_same_subject_makes_the_same_bytes(tmp_path):
    needed("gcc")
    subject = Subject(build("kinematic"), "car", None, source="a test")
    assert files(subject) == files(subject)


def test_without_a_compiler_there_are_sources_and_a_sentence(monkeypatch, tmp_path):
    from greybox_id.export.target_fmu import cautions

    monkeypatch.setenv("CC", "there_is_no_such_compiler")
    subject = Subject(build("kinematic"), "car", None, source="a test")
    assert any("sources only" in sentence for sentence in cautions(subject))
    (tmp_path / "car.fmu").write_bytes(files(subject)["car.fmu"])
    with zipfile.ZipFile(tmp_path / "car.fmu") as held:
        assert not [name for name in held.namelist() if name.startswith("binaries")]
        assert {"sources/car.c", "sources/fmi2.c", "sources/model.h"} <= set(held.namelist())


@pytest.mark.slow
@pytest.mark.parametrize("file", FMUS)
def test_fmpy_compiles_the_sources(bare, tmp_path, file, monkeypatch):
    pytest.importorskip("cmake", reason="cmake is not installed")
    with zipfile.ZipFile(bare[1] / file) as held, zipfile.ZipFile(tmp_path / file, "w") as stripped:
        for name in held.namelist():
            if not name.startswith("binaries/"):
                stripped.writestr(name, held.read(name))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    run(sys.executable, "-m", "fmpy", "compile", tmp_path / file)
    start = {"state.v_x": 15.0, "steer": 0.03}
    ours, theirs = (
        fmpy.simulate_fmu(
            str(own / file), stop_time=2.0, output_interval=0.01, start_values=start, fmi_type="CoSimulation"
        )
        for own in (bare[1], tmp_path)
    )
    np.testing.assert_allclose(ours["yaw_rate"], theirs["yaw_rate"], rtol=1e-12)


@pytest.mark.parametrize("version", [2, 3])
def test_units_can_be_linked_together(tmp_path, version):
    """With a prefix asked for, two units and both their interfaces share no name."""
    objects = []
    for name in ("one", "two"):
        held = files(Subject(build("kinematic"), name, None, source="a test"))
        (tmp_path / f"{name}.zip").write_bytes(held[f"{name}{'_fmi3' * (version == 3)}.fmu"])
        with zipfile.ZipFile(tmp_path / f"{name}.zip") as opened:
            opened.extractall(tmp_path / name)
        for source in (tmp_path / name / "sources").glob("*.c"):
            target = tmp_path / f"{name}_{source.stem}.o"
            run(needed("gcc"), *STRICT, f"-DFMI{version}_FUNCTION_PREFIX", "-fPIC", "-c", source, "-o", target)
            objects.append(target)
    run("gcc", "-shared", *objects, "-lm", "-o", tmp_path / "both.so")
    assert f" T two_fmi{version}DoStep" in run(needed("nm"), "-D", tmp_path / "both.so")


@pytest.mark.parametrize("name", ["single_track", "lateral", "longitudinal", "kinematic"])
def test_inner_steps_are_short_enough_and_not_needlessly_short(name):
    e = Equations(build(name))
    steps, by_x = steps_of(e), e.ode.factory("by_x", ["x", "u", "p"], ["jac:x_dot:x"])
    for v in np.geomspace(0.007, 40, 47):
        x, u = ([v if own.name == "v_x" else 0.0 for own in entries] for entries in (e.states, e.inputs))
        A = np.array(by_x(x, u, e.values))[: len(e.model.states), : len(e.model.states)]  # others are exact
        fastest = np.max(np.abs(np.linalg.eigvals(A)), initial=0.0)
        assert steps.stable(v) * fastest <= 2.7
    assert steps.stable(10.0) > steps.longest


@pytest.mark.parametrize("about", ['<!DOCTYPE x [<!ENTITY a "b">]>&a;"\'', "]]>\x00\x1b\ud800", "*/ int x; /*"])
def test_foreign_texts_stay_texts(about, tmp_path):
    needed("gcc")
    held = files(Subject(build("kinematic"), "car", None, source=about))["car.fmu"]
    (tmp_path / "car.fmu").write_bytes(held)
    with zipfile.ZipFile(tmp_path / "car.fmu") as opened:
        tree = etree.fromstring(opened.read("modelDescription.xml"))
        assert any(name.startswith("binaries/") for name in opened.namelist())
    assert tree.get("description").startswith("kinematic") or "from" in tree.get("description")
    assert validate_fmu(str(tmp_path / "car.fmu")) == []


def test_inner_steps_are_stable_at_a_crawl(tmp_path):
    """A second in one communication step, from a crawl, with the wheels turned: nothing goes astray."""
    model, folder = made(tmp_path / "car", "full_size_car", {})
    assert steps_of(Equations(model)).stable(0.0) < 0.01
    unit = Unit(folder / "car.fmu", tmp_path / "unit")
    unit.begin(state__v_x=0.05, state__v_y=0.3, state__yaw_rate=0.5, steer=0.3, settings__longest_step=0.2)
    unit.step(0.0, 1.0)
    assert np.all(np.abs(unit.get("v_x", "v_y", "yaw_rate")) < 1.0)
    unit.close()


@pytest.mark.slow
@pytest.mark.parametrize("sanitizers", ["address,undefined", "thread"])
@pytest.mark.parametrize("which", ["busy", "bare"])
@pytest.mark.parametrize("version", VERSIONS)
def test_hostile_inputs_in_two_threads_leave_it_clean(request, version, which, sanitizers, tmp_path):
    """10 000 random, huge and missing numbers in inputs, states, parameters and steps; both threads come out alike."""
    with zipfile.ZipFile(request.getfixturevalue(which)[1] / f"car{VERSIONS[version]}.fmu") as held:
        held.extractall(tmp_path)
    shutil.copy(HARNESS / f"fmi{version}.h", tmp_path / "interface.h")
    sources = [tmp_path / "sources" / name for name in ("car.c", "instance.c", f"fmi{version}.c")]
    flags = (
        "-g",
        "-O1",
        f"-fsanitize={sanitizers}",
        "-fno-sanitize-recover=all",
        f"-I{tmp_path / 'sources'}",
        f"-I{tmp_path}",
    )
    run("gcc", *STRICT, *flags, HARNESS / "hostile.c", *sources, "-lm", "-lpthread", "-o", tmp_path / "hostile")
    assert int(run(tmp_path / "hostile")) > 1000


def test_there_is_no_heap_in_an_instance_and_interfaces_take_it_to_begin_with(busy, tmp_path):
    with zipfile.ZipFile(busy[1] / "car_fmi3.fmu") as held:
        held.extractall(tmp_path)
    for name in ("car", "instance", "fmi3"):
        run("gcc", *STRICT, "-O2", "-c", f"{name}.c", "-o", f"{name}.o", cwd=tmp_path / "sources")
    for name in ("car", "instance"):
        assert not {"malloc", "calloc", "realloc", "free"} & set(
            run(needed("nm"), "-u", f"{name}.o", cwd=tmp_path / "sources").split()
        )
    exported = run("nm", "-D", "--defined-only", next((tmp_path / "binaries").rglob("car.so")))
    assert all(line.split()[-1].startswith("fmi3") for line in exported.splitlines())


@pytest.mark.slow
def test_a_step_of_a_unit_takes_no_more_than_twice_that_of_the_c(bare, tmp_path):
    with zipfile.ZipFile(bare[1] / "car.fmu") as held:
        held.extractall(tmp_path)
    sources = [tmp_path / "sources" / name for name in ("car.c", "instance.c")]
    run(
        "gcc",
        *STRICT,
        "-O2",
        f"-I{tmp_path / 'sources'}",
        HARNESS / "race.c",
        *sources,
        "-lm",
        "-o",
        tmp_path / "race",
    )
    plain, unit, _ = map(float, subprocess.run([tmp_path / "race"], capture_output=True, text=True).stdout.split())
    assert unit <= 2 * plain
