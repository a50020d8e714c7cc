"""The file that nnodely's saveModel writes: a graph of relations, and numbers; read and checked, never executed.

Relations name an operation, the relations, inputs or numbers it takes, and what else it needs. Functions hold Python
source as text, which stays text here. Source: nnodely 1.5, github.com/tonegas/nnodely.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.base.files import near_file
from greybox_id.base.guard import protect
from greybox_id.base.shorthands import Array

MOST_BYTES = 5_000_000
"""The paper's networks take 50 kB; read as JSON, a file takes some twenty times its size of memory."""
MOST_NUMBERS = 200_000
"""Numbers in the parameters and constants of one file."""
LONGEST_NAME = 100
LARGEST = 1e12
"""Numbers beyond it mean nothing in a vehicle, and square out of range."""


@dataclass(frozen=True)
class NetworkRelation:
    """A node of the graph.

    Attributes
    ----------
    name, operation : such as "Fir12" and "Fir".
    inputs : names of the relations, inputs and numbers it takes; a ParamFun takes its function's numbers last.
    rest : what else stands in the file: names of weights and functions, windows, indices.
    """

    name: str
    operation: str
    inputs: tuple[str, ...]
    rest: tuple[Any, ...]


@dataclass(frozen=True)
class Network:
    """What a file states.

    Attributes
    ----------
    file : its name, for sentences.
    sample_time : s, as the file states it.
    inputs : name -> name of the relation that feeds it back in closed loop, None where it is measured.
    relations : by name.
    functions : by name, as the file holds them.
    numbers : parameters and constants by name; those without values are missing.
    outputs : name -> relation or input.
    targets : pairs of what training compares.
    """

    file: str
    sample_time: float
    inputs: Mapping[str, str | None]
    relations: Mapping[str, NetworkRelation]
    functions: Mapping[str, Mapping[str, Any]]
    numbers: Mapping[str, Array]
    outputs: Mapping[str, str]
    targets: tuple[tuple[str, str], ...]

    def number(self, name: object, where: str) -> Array:
        """A parameter or constant. Raises `BadInput` where there is none of that name, or it has no values."""
        if not isinstance(name, str) or name not in self.numbers:
            raise self.wrong(f"{where} needs the numbers {_short(name)}, which the file does not hold.")
        return self.numbers[name]

    def wrong(self, sentence: str) -> BadInput:
        """What is wrong with this file, as an error to be raised."""
        return BadInput(f"{self.file}: {sentence}")

    def order(self, root: str, stop: Collection[str] = ()) -> list[str]:
        """Names that `root` follows from, itself last, each after what it takes; what is in `stop` is not entered.

        Raises
        ------
        BadInput : a relation follows from itself, or takes what the file does not hold.
        """
        result: dict[str, bool] = {}  # name -> whether all it takes stands before it
        stack = [(root, "the outputs")]
        while stack:
            name, asked_by = stack[-1]
            if result.get(name):
                stack.pop()
                continue
            relation = self.relations.get(name) if name not in stop else None
            if relation is None:
                if not (name in stop or name in self.inputs or name in self.numbers):
                    raise self.wrong(f"{asked_by} takes {_short(name)}, which the file does not hold.")
                result[name] = True
            elif name in result:
                result.pop(name)
                result[name] = True
            else:
                result[name] = False
                waiting = [item for item in relation.inputs if not result.get(item)]
                if any(item in result for item in waiting):
                    raise self.wrong(f"relation {_short(name)} follows from itself.")
                stack += [(item, f"relation {_short(name)}") for item in reversed(waiting)]
        return list(result)


def read_network(path: str | Path) -> Network:
    """Read a file of nnodely's.

    Raises
    ------
    BadInput : it cannot be read, is too large, or is no such file; the sentence says where.
    """
    file = Path(path)
    body = _json(file)
    parts = {name: _part(body, name, file) for name in ("Info", "Inputs", "Relations", "Outputs")}
    optional = {name: _part(body, name, file, {}) for name in ("Functions", "Parameters", "Constants", "Minimizers")}
    functions = {name: _dict(item) for name, item in optional["Functions"].items()}
    relations = {name: _relation(file, name, part, functions) for name, part in parts["Relations"].items()}
    held = {**optional["Parameters"], **optional["Constants"]}
    numbers = {name: _numbers(file, name, item["values"]) for name, item in held.items() if "values" in _dict(item)}
    if sum(values.size for values in numbers.values()) > MOST_NUMBERS:
        raise BadInput(f"{file} holds more than {MOST_NUMBERS} numbers; no network of this family has as many.")
    names = [*parts["Inputs"], *relations, *held]
    for name in (*names, *functions, *parts["Outputs"]):
        if not name.isprintable() or len(name) > LONGEST_NAME:
            raise BadInput(f"{file}: {_short(name)} is no name; names are of at most {LONGEST_NAME} printable letters.")
    [(twice, count), *_] = Counter(["", *names]).most_common(1)
    if count > 1:
        raise BadInput(f"{file}: {_short(twice)} names two things among inputs, relations, parameters and constants.")
    return Network(
        file=str(file),
        sample_time=_sample_time(file, parts["Info"].get("SampleTime")),
        inputs={name: _loop(file, name, part) for name, part in parts["Inputs"].items()},
        relations=relations,
        functions=functions,
        numbers=numbers,
        outputs={name: _text(file, part, f"output {_short(name)}") for name, part in parts["Outputs"].items()},
        targets=tuple(
            (str(_dict(item).get("A")), str(_dict(item).get("B"))) for item in optional["Minimizers"].values()
        ),
    )


def _json(file: Path) -> dict[str, Any]:
    protect(file)
    try:
        if not file.is_file():
            raise BadInput(f"{file} is not a file; name a file that nnodely's saveModel wrote.{near_file(file)}")
        with file.open("rb") as opened:
            content = opened.read(MOST_BYTES + 1)
    except (OSError, ValueError) as error:
        raise BadInput(f"{file} cannot be read: {getattr(error, 'strerror', None) or error}.") from error
    if len(content) > MOST_BYTES:
        raise BadInput(f"{file} is larger than {MOST_BYTES // 1_000_000} MB; no network of this family is.")
    try:
        body = json.loads(content.decode("utf-8"), object_pairs_hook=_once, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{file} is not JSON as nnodely's saveModel writes it ({error}).") from error
    if not isinstance(body, dict):
        raise BadInput(f"{file} is not a file of nnodely's saveModel: it holds no object.")
    return body


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) < len(pairs):
        raise ValueError("a name stands twice in one object")
    return result


def _no_constant(word: str) -> float:
    raise ValueError(f"it holds {word}, which is not a number; a training that diverged leaves such files")


def _part(body: Mapping[str, Any], name: str, file: Path, otherwise: dict[str, Any] | None = None) -> dict[str, Any]:
    part = body.get(name, otherwise)
    if not isinstance(part, dict):
        raise BadInput(f"{file} is not a file of nnodely's saveModel: {name} is missing or no object.")
    return part


def _relation(file: Path, name: str, value: Any, functions: Mapping[str, Mapping[str, Any]]) -> NetworkRelation:
    match value:
        case [str(operation), [str(), *_] as taken, *rest] if all(isinstance(one, str) for one in taken):
            if operation == "ParamFun" and rest and isinstance(rest[0], str):
                numbers = functions.get(rest[0], {}).get("params_and_consts", [])
                if not (isinstance(numbers, list) and all(isinstance(one, str) for one in numbers)):
                    raise BadInput(f"{file}: function {_short(rest[0])} does not list its parameters.")
                taken = [*taken, *numbers]
            return NetworkRelation(name, operation, tuple(taken), tuple(rest))
    raise BadInput(f"{file}: relation {_short(name)} is not [operation, [what it takes], ...].")


def _loop(file: Path, name: str, value: Any) -> str | None:
    value = _dict(value)
    if value.get("dim") != 1:
        raise BadInput(f"{file}: input {_short(name)} is not a single signal (dim {_short(value.get('dim'))}).")
    if "connect" in value:
        raise BadInput(
            f"{file}: input {_short(name)} is connected to {_short(value['connect'])} within one sample. Models of "
            "greybox-id feed predictions back from one sample to the next: use addClosedLoop in place of addConnect."
        )
    return _text(file, value["closedLoop"], f"the loop of input {_short(name)}") if "closedLoop" in value else None


def _numbers(file: Path, name: str, values: Any) -> Array:
    flat = values
    for _ in range(3):  # weights have two axes, [window, outputs]; a number may stand alone
        if isinstance(flat, list) and flat and all(isinstance(row, list) for row in flat):
            flat = [item for row in flat for item in row]
    flat = flat if isinstance(flat, list) else [flat]
    if not flat or not all(isinstance(item, (int, float)) and not isinstance(item, bool) for item in flat):
        raise BadInput(f"{file}: the values of {_short(name)} are not numbers in rows and columns.")
    if not all(abs(item) <= LARGEST for item in flat):
        raise BadInput(f"{file}: {_short(name)} holds a number beyond {LARGEST:g}.")
    try:
        return np.array(values, dtype=float)
    except ValueError as error:
        raise BadInput(f"{file}: the rows of {_short(name)} differ in length.") from error


def _sample_time(file: Path, value: Any) -> float:
    if isinstance(value, (int, float)) and not isinstance(value, bool) and 0 < value < LARGEST:
        return float(value)
    raise BadInput(f"{file}: Info.SampleTime is not a number above zero; nnodely writes it after neuralizeModel.")


def _text(file: Path, value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise BadInput(f"{file}: {where} is not the name of a relation.")
    return value


def _dict(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _short(value: object) -> str:
    """A word of the file as a sentence can quote it: what it does not expect may be long, or steer a terminal."""
    text = repr(value) if not isinstance(value, str) or not value.isprintable() else value
    return text if len(text) <= 60 else text[:57] + "..."
