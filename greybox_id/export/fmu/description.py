"""Description of a functional mock-up unit: variables, `modelDescription.xml` and `buildDescription.xml`.

Source: the FMI standards, 2.0.4 and 3.0.2.

Also the length of a unit's inner steps: the slower a vehicle, the stiffer its equations.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from xml.etree.ElementTree import Element, indent, tostring

import numpy as np

from ...base.units import si_exponents
from ...base.version import __version__
from ...engine.motion.schedule import STABLE
from ...models.smooth import SLOWEST
from ..c.naming import xml_text
from ..equations import Equations
from ..subject import Subject

LONGEST = 0.01
"""Default longest inner step, s: that of recordings at 100 Hz."""
SPEEDS = (0.0, *np.geomspace(0.005, 40.0, 60).tolist())
"""Speeds, m/s, at which the fastest eigenvalue is evaluated."""


@dataclass(frozen=True)
class Steps:
    """Bounds of inner steps.

    Attributes
    ----------
    longest : the longest, s.
    stiff, by_speed : eigenvalues are at most stiff + by_speed / speed, 1/s and m/s^2.
    slowest : speed, m/s, below which the bound is constant.
    """

    longest: float
    stiff: float
    by_speed: float
    slowest: float

    def stable(self, speed: float) -> float:
        """The longest stable step at a speed, s."""
        return STABLE / (self.stiff + self.by_speed / max(speed, self.slowest))


def steps_of(equations: Equations) -> Steps:
    """Steps from the eigenvalues of the equations straight ahead: the largest falls as 1/v, and is bounded at rest."""
    model = equations.model
    count, slowest = len(model.states), SLOWEST / 2
    jacobian = equations.ode.factory("by_x", ["x", "u", "p"], ["jac:x_dot:x"])
    fastest = []
    for v in SPEEDS:
        x = np.array([v if state.name == "v_x" else 0.0 for state in equations.states])
        u = np.array([v if item.name == "v_x" else 0.0 for item in equations.inputs])
        A = np.array(jacobian(x, u, equations.values))[:count, :count]
        finite = bool(np.all(np.isfinite(A)))
        fastest.append(float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0)) if finite else 0.0)
    stiff = max(min(fastest), 1e-9)
    by_speed = max((item - stiff) * max(v, slowest) for v, item in zip(SPEEDS, fastest, strict=True))
    return Steps(LONGEST, stiff, by_speed, slowest)


REFERENCES = 1000
"""A value reference is this times the index of the kind, plus the place; the C sources use the same number."""
KINDS = ("time", "input", "output", "state", "rate", "parameter", "setting")


@dataclass(frozen=True)
class Variable:
    """A variable.

    Attributes
    ----------
    name : unique, in FMI's structured notation.
    place : index among its kind.
    unit, about : SI unit; meaning, for people.
    start : initial value; None if it is computed.
    low, high : bounds, if any.
    interval : 95 % interval of an estimate.
    """

    name: str
    kind: str
    place: int
    unit: str
    about: str = ""
    start: float | None = None
    low: float | None = None
    high: float | None = None
    interval: tuple[float, float] | None = None

    @property
    def reference(self) -> int:
        """The value reference."""
        return REFERENCES * KINDS.index(self.kind) + self.place


def continuous(equations: Equations) -> bool:
    """Whether the model is a plain differential equation, so that importers may integrate it."""
    model = equations.model
    return not (model.actuators or model.relaxations or equations.delayed or equations.late)


def variables_of(subject: Subject, steps: Steps) -> list[Variable]:
    """All variables, in the order of the description."""
    e = subject.equations
    inputs = {item.name for item in e.inputs}
    result = [Variable("time", "time", 0, "s", "simulation time")]
    result += [Variable(i.name, "input", k, i.unit, i.about, 0.0) for k, i in enumerate(e.inputs)]
    for k, output in enumerate(e.outputs):
        name = f"reading.{output.name}" if output.name in inputs else output.name
        result.append(Variable(name, "output", k, output.unit, output.about or "as its sensor reads it"))
    for k, output in enumerate(e.states):
        result.append(Variable(f"state.{output.name}", "state", k, output.unit, output.about, 0.0))
    if continuous(e):
        result += [
            Variable(f"der(state.{state.name})", "rate", k, f"{state.unit} s^-1", f"derivative of {state.name}")
            for k, state in enumerate(e.states)
        ]
    result += _parameters(subject)
    about = (
        "longest inner step of the Runge-Kutta method; near standstill, where the equations are stiff, shorter "
        "steps are taken"
    )
    return [*result, Variable("settings.longest_step", "setting", 0, "s", about, steps.longest, 0.0)]


def _parameters(subject: Subject) -> Iterator[Variable]:
    e = subject.equations
    known = {p.name: p for p in subject.model.parameters}
    intervals = subject.described()["parameters"]
    for k, (item, value) in enumerate(zip(e.parameters, e.values.tolist(), strict=True)):
        parameter = known.get(item.name)
        low, high = (None, None) if parameter is None else _kept_bounds(parameter.bounds, value)
        interval = None if parameter is None else intervals[item.name]["interval"]
        yield Variable(
            f"parameters.{item.name}", "parameter", k, item.unit, item.about, value, low, high,
            None if interval is None else (float(interval[0]), float(interval[1])),
        )  # fmt: skip


def _kept_bounds(bounds: tuple[float, float], value: float) -> tuple[float | None, float | None]:
    """The finite bounds that the value satisfies."""
    low, high = bounds
    return low if isfinite(low) and low <= value else None, high if isfinite(high) and value <= high else None


SOURCES = ("{name}.c", "instance.c", "fmi{version}.c")
CAUSALITY = {
    "time": "independent", "input": "input", "output": "output", "state": "local", "rate": "local",
    "parameter": "parameter", "setting": "parameter",
}  # fmt: skip
VARIABILITY = {"parameter": "tunable", "setting": "fixed"}
INTERVAL = "greybox-id.interval"
RESULTS = ("output", "rate")
"""Kinds of computed variables."""


@dataclass(frozen=True)
class Description:
    """Description of a unit.

    Attributes
    ----------
    name : the model's identifier.
    about : for people.
    token : identifier shared by binary and description.
    variables : all of them.
    continuous : whether model exchange is offered.
    step : default communication step, s.
    """

    name: str
    about: str
    token: str
    variables: Sequence[Variable]
    continuous: bool
    step: float

    def model(self, version: int) -> str:
        """`modelDescription.xml` of FMI 2 or 3."""
        older = version == 2
        token = "guid" if older else "instantiationToken"
        root = _element(
            "fmiModelDescription", fmiVersion=f"{version}.0", modelName=self.name, **{token: self.token},
            description=self.about, generationTool=f"greybox-id {__version__}", variableNamingConvention="structured",
            numberOfEventIndicators="0" if older else None,
        )  # fmt: skip
        can = (
            ("canGetAndSetFMUstate", "canSerializeFMUstate", "providesDirectionalDerivative")
            if older
            else ("canGetAndSetFMUState", "canSerializeFMUState", "providesDirectionalDerivatives")
        )
        files = [_element("File", name=file) for file in self.sources(2)]
        for kind in ("ModelExchange", "CoSimulation") if self.continuous else ("CoSimulation",):
            more = ("canHandleVariableCommunicationStepSize",) if kind == "CoSimulation" else ()
            inside = [_element("SourceFiles", files)] if older else []
            root.append(_element(kind, inside, modelIdentifier=self.name, **dict.fromkeys((*can, *more), "true")))
        root.append(_element("UnitDefinitions", map(_unit, self._units())))
        root.append(_element("LogCategories", [_element("Category", name="logStatusError")]))
        root.append(_element("DefaultExperiment", startTime="0", stopTime="10", stepSize=repr(self.step)))
        places = {one.name: k if older else one.reference for k, one in enumerate(self.variables, 1)}
        root.append(_element("ModelVariables", [_variable(one, places, older) for one in self.variables]))
        outputs, rates = ([places[one.name] for one in self.variables if one.kind == kind] for kind in RESULTS)
        root.append(_element("ModelStructure", _structure2(outputs, rates) if older else _structure3(outputs, rates)))
        return _written(root)

    def build(self, version: int) -> str:
        """`buildDescription.xml`: how to compile the sources to a shared library, whose functions have plain names."""
        files = [_element("SourceFile", name=file) for file in self.sources(version)]
        plain = _element("PreprocessorDefinition", name=f"FMI{version}_OVERRIDE_FUNCTION_PREFIX", value="1")
        sources = _element("SourceFileSet", [*files, plain], language="C99")
        whole = _element("BuildConfiguration", [sources], modelIdentifier=self.name)
        return _written(_element("fmiBuildDescription", [whole], fmiVersion="3.0"))

    def sources(self, version: int) -> list[str]:
        """Names of the C files to compile."""
        return [file.format(name=self.name, version=version) for file in SOURCES]

    def _units(self) -> list[str]:
        return list(dict.fromkeys(variable.unit for variable in self.variables if variable.unit))


def _element(tag: str, inside: Iterable[Element] = (), /, **attributes: str | None) -> Element:
    """An XML element; attributes that are None are omitted."""
    result = Element(tag, {name: xml_text(text) for name, text in attributes.items() if text is not None})
    result.extend(inside)
    return result


def _written(root: Element) -> str:
    indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{tostring(root, "unicode")}\n'


def _unit(unit: str) -> Element:
    exponents = si_exponents(unit)
    base = {} if exponents is None else {name: str(value) for name, value in exponents.items()}
    return _element("Unit", [] if exponents is None else [_element("BaseUnit", **base)], name=unit)


def _variable(one: Variable, places: Mapping[str, int], older: bool) -> Element:
    """A variable, of FMI 2 if `older`; `places` are that version's references to other variables."""
    computed = one.kind in RESULTS
    head: dict[str, str | None] = {
        "name": one.name, "valueReference": str(one.reference), "description": one.about or None,
        "causality": CAUSALITY[one.kind], "variability": VARIABILITY.get(one.kind, "continuous"),
        "initial": None if one.kind in ("time", "input") else "calculated" if computed else "exact",
    }  # fmt: skip
    number = {
        "unit": one.unit or None, "min": _limit(one.low), "max": _limit(one.high),
        "derivative": str(places[one.name[4:-1]]) if one.kind == "rate" else None, "start": _limit(one.start),
    }  # fmt: skip
    notes = []
    if one.interval is not None:
        low, high = map(repr, one.interval)
        said = [_element("Interval", level="0.95", low=low, high=high)]
        note = _element("Tool", said, name="greybox-id") if older else _element("Annotation", said, type=INTERVAL)
        notes = [_element("Annotations", [note])]
    if older:
        return _element("ScalarVariable", [_element("Real", **number), *notes], **head)
    return _element("Float64", notes, **head, **number)


def _limit(value: float | None) -> str | None:
    """A number in XML Schema's notation, with INF for infinity."""
    return None if value is None else {float("inf"): "INF", float("-inf"): "-INF"}.get(value, repr(value))


def _structure2(outputs: Sequence[int], rates: Sequence[int]) -> list[Element]:
    unknown = {"Outputs": outputs, "Derivatives": rates, "InitialUnknowns": [*outputs, *rates]}
    return [
        _element(name, [_element("Unknown", index=str(place)) for place in places])
        for name, places in unknown.items()
        if places or name != "Derivatives"
    ]


def _structure3(outputs: Sequence[int], rates: Sequence[int]) -> list[Element]:
    unknown = {"Output": outputs, "ContinuousStateDerivative": rates, "InitialUnknown": [*outputs, *rates]}
    return [_element(name, valueReference=str(place)) for name, places in unknown.items() for place in places]
