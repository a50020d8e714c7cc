"""What a functional mock-up unit says of itself: its variables, `modelDescription.xml` and `buildDescription.xml`.

Source: the FMI standards, 2.0.4 and 3.0.2.

How long inner steps of a unit may be: the slower a vehicle, the stiffer its equations.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from ...base.units import si_exponents
from ...base.version import __version__
from ...engine.motion.schedule import STABLE
from ...models.smooth import SLOWEST
from ..c.naming import xml_attribute as quoted
from ..equations import Equations
from ..subject import Subject

LONGEST = 0.01
"""Longest inner step unless somebody says otherwise, s: that of recordings at 100 Hz."""
SPEEDS = (0.0, *np.geomspace(0.005, 40.0, 60).tolist())
"""Speeds, m/s, at which the fastest eigenvalue is asked for."""


@dataclass(frozen=True)
class Steps:
    """Inner steps.

    Attributes
    ----------
    longest : the longest, s.
    stiff, by_speed : eigenvalues are at most stiff + by_speed / speed, 1/s and m/s^2.
    slowest : speed, m/s, below which they grow no more.
    """

    longest: float
    stiff: float
    by_speed: float
    slowest: float

    def stable(self, speed: float) -> float:
        """The longest stable step at a speed, s."""
        return STABLE / (self.stiff + self.by_speed / max(speed, self.slowest))


def steps_of(equations: Equations) -> Steps:
    """From the eigenvalues of the equations, driven straight: the largest falls as 1/v, and is bounded at rest."""
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
"""A value reference is this times the kind, plus the place; as the C has it."""
KINDS = ("time", "input", "output", "state", "rate", "parameter", "setting")


@dataclass(frozen=True)
class Variable:
    """A variable.

    Attributes
    ----------
    name : unique, in FMI's structured notation.
    kind : one of `KINDS`.
    place : among its kind.
    unit, about : SI; for people.
    start : None where it is computed.
    low, high : bounds, where there are any.
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
    """Whether the model is a differential equation and nothing besides, so that any integrator may have it."""
    model = equations.model
    return not (model.actuators or model.relaxations or equations.delayed or equations.late)


def variables_of(subject: Subject, steps: Steps) -> list[Variable]:
    """All variables, in the order in which they stand in the description."""
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
    """Finite ones that the value keeps to."""
    low, high = bounds
    return low if isfinite(low) and low <= value else None, high if isfinite(high) and value <= high else None


SOURCES = ("{name}.c", "instance.c", "fmi{version}.c")
CAUSALITY = {
    "time": "independent", "input": "input", "output": "output", "state": "local", "rate": "local",
    "parameter": "parameter", "setting": "parameter",
}  # fmt: skip
VARIABILITY = {"parameter": "tunable", "setting": "fixed"}
INTERVAL = "greybox-id.interval"


@dataclass(frozen=True)
class Description:
    """What is said of a unit.

    Attributes
    ----------
    name : the model's identifier.
    about : for people.
    token : what binary and description know each other by.
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
        return self._fmi2() if version == 2 else self._fmi3()

    def build(self, version: int) -> str:
        """`buildDescription.xml`: how the sources become a shared library, whose functions have plain names."""
        files = "".join(f'      <SourceFile name="{file}"/>\n' for file in self.sources(version))
        plain = f'      <PreprocessorDefinition name="FMI{version}_OVERRIDE_FUNCTION_PREFIX" value="1"/>\n'
        return (
            '<?xml version="1.0" encoding="UTF-8"?>\n'
            '<fmiBuildDescription fmiVersion="3.0">\n'
            f'  <BuildConfiguration modelIdentifier="{self.name}">\n'
            f'    <SourceFileSet language="C99">\n{files}{plain}    </SourceFileSet>\n'
            "  </BuildConfiguration>\n</fmiBuildDescription>\n"
        )

    def sources(self, version: int) -> list[str]:
        """Names of the C files that are compiled."""
        return [file.format(name=self.name, version=version) for file in SOURCES]

    def _of(self, *kinds: str) -> list[Variable]:
        return [variable for variable in self.variables if variable.kind in kinds]

    def _units(self) -> str:
        lines = []
        for unit in dict.fromkeys(variable.unit for variable in self.variables if variable.unit):
            exponents = si_exponents(unit)
            base = ""
            if exponents is not None:
                base = f"<BaseUnit{''.join(f' {key}={quoted(str(value))}' for key, value in exponents.items())}/>"
            lines.append(f"    <Unit name={quoted(unit)}>{base}</Unit>\n")
        return f"  <UnitDefinitions>\n{''.join(lines)}  </UnitDefinitions>\n"

    def _experiment(self) -> str:
        return f'  <DefaultExperiment startTime="0" stopTime="10" stepSize={quoted(repr(self.step))}/>\n'

    def _head(self, version: str, token: str) -> str:
        return (
            f'<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription fmiVersion="{version}" '
            f"modelName={quoted(self.name)} {token}={quoted(self.token)} description={quoted(self.about)} "
            f'generationTool="greybox-id {__version__}" variableNamingConvention="structured"'
        )

    def _fmi2(self) -> str:
        files = "".join(f"      <File name={quoted(file)}/>\n" for file in self.sources(2))
        can = (
            f'modelIdentifier={quoted(self.name)} canGetAndSetFMUstate="true" canSerializeFMUstate="true" '
            'providesDirectionalDerivative="true"'
        )
        interfaces = ""
        if self.continuous:
            interfaces += f"  <ModelExchange {can}>\n    <SourceFiles>\n{files}    </SourceFiles>\n  </ModelExchange>\n"
        interfaces += (
            f'  <CoSimulation {can} canHandleVariableCommunicationStepSize="true">\n'
            f"    <SourceFiles>\n{files}    </SourceFiles>\n  </CoSimulation>\n"
        )
        place = {variable.name: k for k, variable in enumerate(self.variables, 1)}
        rows = "".join(self._variable2(variable, place) for variable in self.variables)
        outputs = "".join(f'      <Unknown index="{place[item.name]}"/>\n' for item in self._of("output"))
        rates = "".join(f'      <Unknown index="{place[item.name]}"/>\n' for item in self._of("rate"))
        structure = f"    <Outputs>\n{outputs}    </Outputs>\n"
        if rates:
            structure += f"    <Derivatives>\n{rates}    </Derivatives>\n"
        structure += f"    <InitialUnknowns>\n{outputs}{rates}    </InitialUnknowns>\n"
        return (
            f'{self._head("2.0", "guid")} numberOfEventIndicators="0">\n{interfaces}{self._units()}'
            '  <LogCategories>\n    <Category name="logStatusError"/>\n  </LogCategories>\n'
            f"{self._experiment()}  <ModelVariables>\n{rows}  </ModelVariables>\n"
            f"  <ModelStructure>\n{structure}  </ModelStructure>\n</fmiModelDescription>\n"
        )

    def _variable2(self, value: Variable, place: dict[str, int]) -> str:
        unit = f" unit={quoted(value.unit)}" if value.unit else ""
        derivative = f' derivative="{place[value.name[4:-1]]}"' if value.kind == "rate" else ""
        note = ""
        if value.interval is not None:
            low, high = map(repr, value.interval)
            note = (
                f'\n      <Annotations><Tool name="greybox-id"><Interval level="0.95" low="{low}" high="{high}"/>'
                "</Tool></Annotations>\n    "
            )
        return (
            f'    <ScalarVariable name={quoted(value.name)} valueReference="{value.reference}"{_described(value)} '
            f"{_kind(value)}><Real{unit}{_bounds(value)}{derivative}{_start(value)}/>{note}</ScalarVariable>\n"
        )

    def _fmi3(self) -> str:
        can = (
            f'modelIdentifier={quoted(self.name)} canGetAndSetFMUState="true" canSerializeFMUState="true" '
            'providesDirectionalDerivatives="true"'
        )
        interfaces = f"  <ModelExchange {can}/>\n" if self.continuous else ""
        interfaces += f'  <CoSimulation {can} canHandleVariableCommunicationStepSize="true"/>\n'
        reference = {variable.name: variable.reference for variable in self.variables}
        rows = "".join(self._variable3(variable, reference) for variable in self.variables)
        outputs = "".join(f'    <Output valueReference="{item.reference}"/>\n' for item in self._of("output"))
        rates = [item.reference for item in self._of("rate")]
        structure = outputs
        structure += "".join(f'    <ContinuousStateDerivative valueReference="{rate}"/>\n' for rate in rates)
        unknown = [*(item.reference for item in self._of("output")), *rates]
        structure += "".join(f'    <InitialUnknown valueReference="{item}"/>\n' for item in unknown)
        return (
            f"{self._head('3.0', 'instantiationToken')}>\n{interfaces}{self._units()}"
            '  <LogCategories>\n    <Category name="logStatusError"/>\n  </LogCategories>\n'
            f"{self._experiment()}  <ModelVariables>\n{rows}  </ModelVariables>\n"
            f"  <ModelStructure>\n{structure}  </ModelStructure>\n</fmiModelDescription>\n"
        )

    def _variable3(self, one: Variable, reference: dict[str, int]) -> str:
        unit = f" unit={quoted(one.unit)}" if one.unit else ""
        derivative = f' derivative="{reference[one.name[4:-1]]}"' if one.kind == "rate" else ""
        head = (
            f'    <Float64 name={quoted(one.name)} valueReference="{one.reference}"{_described(one)} {_kind(one)}'
            f"{unit}{_bounds(one)}{derivative}{_start(one)}"
        )
        if one.interval is None:
            return f"{head}/>\n"
        low, high = map(repr, one.interval)
        return (
            f'{head}>\n      <Annotations><Annotation type="{INTERVAL}"><Interval level="0.95" low="{low}" '
            f'high="{high}"/></Annotation></Annotations>\n    </Float64>\n'
        )


def _described(variable: Variable) -> str:
    return f" description={quoted(variable.about)}" if variable.about else ""


def _kind(value: Variable) -> str:
    computed = ' initial="calculated"'
    initial = {"time": "", "input": "", "output": computed, "rate": computed}.get(value.kind, ' initial="exact"')
    return f'causality="{CAUSALITY[value.kind]}" variability="{VARIABILITY.get(value.kind, "continuous")}"{initial}'


def _bounds(variable: Variable) -> str:
    low = "" if variable.low is None else f' min="{variable.low!r}"'
    return low + ("" if variable.high is None else f' max="{variable.high!r}"')


def _start(variable: Variable) -> str:
    return "" if variable.start is None else f' start="{_xml_number(variable.start)}"'


def _xml_number(value: float) -> str:
    """As XML Schema has it: INF is no limit."""
    return {float("inf"): "INF", float("-inf"): "-INF"}.get(value, repr(value))
