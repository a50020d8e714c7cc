"""Files for MATLAB: the .mat opens and holds what the model has; the C runs against stand-ins of MATLAB's headers.

MATLAB itself is not there: the stand-ins have the functions that its documentation names.
"""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from compiled import STRICT, needed, run
from scipy.io import loadmat

from greybox_id.export.equations import Equations
from greybox_id.export.subject import Subject
from greybox_id.export.target_simulink import cautions, files, origins
from greybox_id.fitting.fit import Fit
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

HARNESS = Path(__file__).with_name("harness")
"""What MATLAB's own headers declare of what is called, and a program that drives an S-function."""


def written(folder, effects=None, moving=None, fit=None, source="a test"):
    car = vehicle("full_size_car")
    model = build("single_track", {}, effects or {}, car)
    meant = Subject(model, "car", moving, None if fit is None else fit(model), source=source, vehicle=car)
    folder.mkdir(exist_ok=True)
    for name, content in files(meant).items():
        (folder / name).write_bytes(content)
    return meant


def fit_of(model):
    rng = np.random.default_rng(0)
    A = rng.standard_normal((model.size, model.size))
    sd = {p.name: 0.05 * np.abs(p.array) for p in model.parameters if not p.fixed}
    return Fit(model, sd, (), {}, (), "given", 0, covariance=A @ A.T)


def test_the_mat_file_holds_parameters_and_their_covariance(tmp_path):
    moving = ("m", "I_z", "B_f")
    meant = written(tmp_path, moving=moving, fit=fit_of)
    car = loadmat(tmp_path / "car.mat", simplify_cells=True)["car"]
    assert car["parameters"] == {name: float(meant.model[name].array) for name in moving}
    assert (list(car["names"]), list(car["units"])) == (list(moving), ["kg", "kg m^2", "1/rad"])
    names = [p.name for p in meant.model.parameters]
    rows = [names.index(name) for name in moving]
    np.testing.assert_array_equal(car["covariance"], meant.fit.covariance[np.ix_(rows, rows)])
    assert [origin.key for origin in origins(meant)] == [f"car.parameters.{name}" for name in moving]


def test_the_same_subject_makes_the_same_bytes_and_no_time(tmp_path):
    first, second = (files(written(tmp_path)) for _ in range(2))
    assert first == second
    assert b"Created" not in first["car.mat"][:128]
    car = loadmat(tmp_path / "car.mat", simplify_cells=True)["car"]
    assert np.all(np.isnan(car["covariance"]))


@pytest.mark.parametrize("effects", [{}, {"steering_lag": 0.05, "tyre_relaxation": 0.3}])
def test_the_function_that_idnlgrey_calls_is_the_models(tmp_path, effects):
    moving = ("m", "I_z", "B_f")
    meant = written(tmp_path, effects, moving)
    (tmp_path / "told.c").write_text("const char *told = 0;\n")
    sources = [tmp_path / name for name in ("car_mex.c", "car.c", "told.c")]
    flags = [*STRICT, "-Wno-unused-function", f"-I{tmp_path}", f"-I{HARNESS}", "-shared", "-fPIC"]
    run(needed("gcc"), *flags, *sources, "-lm", "-o", tmp_path / "mex.so")
    library, e = ctypes.CDLL(str(tmp_path / "mex.so")), Equations(meant.model, moving)

    class Held(ctypes.Structure):
        _fields_ = (("count", ctypes.c_size_t), ("values", ctypes.POINTER(ctypes.c_double)))

    def held(values):
        array = (ctypes.c_double * len(values))(*values)
        return Held(len(values), ctypes.cast(array, ctypes.POINTER(ctypes.c_double)))

    x, u = np.r_[12.0, 0.3, 0.2, np.full(len(e.states) - 3, 0.01)], np.array([0.04, 0.5])
    p = e.values * 1.1
    given = [held([0.0]), held(x), held(u), *(held([value]) for value in p), held([])]
    results, arguments = (ctypes.POINTER(Held) * 2)(), (ctypes.POINTER(Held) * len(given))(*map(ctypes.pointer, given))
    library.mexFunction(2, results, len(given), arguments)
    found = [[result[0].values[k] for k in range(result[0].count)] for result in results]
    np.testing.assert_allclose(found[0], np.array(e.ode(x, u, p)).ravel(), rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(found[1], np.array(e.output(x, u, p)).ravel(), rtol=1e-10, atol=1e-12)
    library.mexFunction(1, results, 3, arguments)
    told = ctypes.c_char_p.in_dll(library, "told").value
    assert b"number of parameters do not fit" in told


@pytest.mark.parametrize("starts", [0, 1])
@pytest.mark.parametrize("effects", [{}, {"steering_delay": 0.037, "steering_lag": 0.05}])
def test_the_s_function_steps_as_the_model_does(tmp_path, effects, starts):
    meant = written(tmp_path, effects)
    flags = [
        "-DMATLAB_MEX_FILE",
        f"-DSTARTS={starts}",
        f"-I{tmp_path}",
        f"-I{HARNESS}",
        "-Wno-unused-function",
        "-Wno-unused-value",
    ]
    flags.append("-fsanitize=address,undefined")
    sources = [tmp_path / name for name in ("car_sfun.c", "car.c")]
    run(needed("gcc"), *STRICT, *flags, *sources, "-lm", "-o", tmp_path / "sfun")
    found = np.array([line.split() for line in run(tmp_path / "sfun").splitlines()], dtype=float)
    e = Equations(meant.model)
    x = np.zeros(len(e.states))
    x[0] = 10.0 * starts
    if not starts and e.settles:
        x = np.array(e.settled(x, [0.0, 0.0], e.values)).ravel()
    steer, true = [0.0 if k < 5 else 0.05 for k in range(40)], []
    parts = ((4, 0.007), (3, 0.003)) if effects else ((0, 0.01),)
    for k in range(40):
        now = steer[max(0, k - 4)] if effects else steer[k]
        true.append(np.array(e.output(x, [now, 1.0], e.values)).ravel())
        for behind, h in parts:
            x = np.array(e.step(x, [steer[k - behind] if k >= behind else 0.0, 1.0], e.values, h)).ravel()
    tolerance = 1e-10 if starts else 1e-6  # from rest the equations are too stiff for steps of 10 ms
    np.testing.assert_allclose(found, true, rtol=tolerance, atol=0.1 * tolerance)


def test_the_model_file_has_every_parameter_with_bounds(tmp_path):
    meant = written(tmp_path, {"steering_rate_limit": float("inf")}, source="it's\n% mine")
    text = (tmp_path / "car_idnlgrey.m").read_text()
    for parameter in meant.equations.parameters:
        assert f"    '{parameter.name}', '{parameter.unit}', " in text
    assert "'steering_rate_limit', 'rad/s', Inf, 0.1, Inf, " in text
    assert "'m', 'kg', 1457.2, 0.5, 60000.0, false" in text
    assert "'l_f', 'm', 1.296, 0.05, 8.0, true" in text
    lines = text.splitlines()
    assert lines[0] == "function model = car_idnlgrey()"
    assert all(line.startswith("%") for line in lines[1:3])


def test_what_the_files_lack_is_said(tmp_path):
    told = " ".join(cautions(written(tmp_path, {"steering_delay": 0.03, "sensor_latency_imu": 0.02})))
    assert "The idnlgrey model lacks the delay of steer" in told
    assert "yaw_rate, a_x, a_y: put a delay" in told
    assert "covariance of the parameters is not known" in told
