"""The column map as the page shows it: entries that are decided, questions, answers; written as TOML.

What a column may be is what `greybox data map` says; nothing is guessed here. An entry is what that command prints of a
signal, and `use`: True where it is in the map, False where it is not, None while it is a question.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomli_w

from .beneath import SIGNALS, write_atomically

Entry = dict[str, Any]

USUAL_UNITS = {
    "m/s": ("m/s", "km/h", "mph"),
    "rad/s": ("rad/s", "deg/s", "rpm"),
    "rad": ("rad", "deg"),
    "m/s^2": ("m/s^2", "g"),
    "m": ("m", "mm"),
}
"""SI unit -> units that loggers write, where nothing tells which: offered in this order."""
TIME_UNITS = ("s", "ms", "us", "ns")


def entries_of(answer: Mapping[str, Any]) -> list[Entry]:
    """What `greybox data map --json` says of columns, as entries."""
    return [{**each, "use": True if each["decided"] else None} for each in answer["signals"]]


def base_of(proposed: Path, answer: Mapping[str, Any]) -> dict[str, Any]:
    """What a proposed map says beside its signals: time, runs, separators, what commands do between rows."""
    try:
        text = tomllib.loads(proposed.read_text("utf-8"))
    except (OSError, tomllib.TOMLDecodeError):
        text = {}
    base = {key: value for key, value in text.items() if key not in ("name", "signals", "extra")}
    time = answer["time"]
    if time is not None and not {"column", "unit"} <= base.get("time", {}).keys():
        base["time"] = {"column": time["column"], "unit": time["unit"] or (time["units"] or ["s"])[0]}
        base["time_units"] = list(time["units"] or TIME_UNITS)
    elif time is None:
        base.pop("time", None)
    return base


def units_for(entry: Entry) -> list[str]:
    """Units that come into question for an entry, the likeliest first."""
    if entry["unit"] and not entry["units"]:
        return [entry["unit"]]
    signal = SIGNALS.get(entry["signal"])
    usual = USUAL_UNITS.get(signal.unit, (signal.unit,)) if signal else ("1",)
    return list(entry["units"] or ([entry["unit"]] if entry["unit"] else usual))


def questions(entries: Sequence[Entry]) -> list[Entry]:
    """Entries that are open; none of a signal that has its column already."""
    taken = {entry["signal"] for entry in entries if entry["use"]}
    return [entry for entry in entries if entry["use"] is None and entry["signal"] not in taken]


def answered(entries: Sequence[Entry], entry: Entry, **answer: Any) -> list[Entry]:
    """Entries with one of them answered; a column that is taken for a signal takes it from the others."""
    changed = []
    for each in entries:
        if each["signal"] == entry["signal"] and each["column"] == entry["column"]:
            changed.append({**each, **answer})
        elif answer.get("use") and each["signal"] == answer.get("signal", entry["signal"]) and each["use"]:
            changed.append({**each, "use": None})
        else:
            changed.append(each)
    return changed


def table_of(
    base: Mapping[str, Any], entries: Sequence[Entry], extra: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """The column map as plain data."""
    table = {key: value for key, value in base.items() if key not in ("time_units", "extra")}
    signals = {entry["signal"]: column_of(entry) for entry in entries if entry["use"]}
    more = {**base.get("extra", {}), **extra}
    return {"name": "map", **table, "signals": signals, **({"extra": more} if more else {})}


def column_of(entry: Entry, unit: str = "") -> dict[str, Any]:
    """One column as a map has it."""
    column: dict[str, Any] = {**entry.get("more", {}), "column": entry["column"], "unit": unit or units_for(entry)[0]}
    if entry["sign"] != 1:
        column["sign"] = -1
    if entry["divide_by"] != 1.0:
        column["divide_by"] = entry["divide_by"]
    return column


def write_map(
    path: Path, base: Mapping[str, Any], entries: Sequence[Entry], extra: Mapping[str, Mapping[str, Any]] | None = None
) -> None:
    """Write the column map, atomically."""
<<<<<<< HEAD
    write_atomically(path, as_toml(table_of(base, entries, extra or {})))


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return f"{value!r}"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{name} = {_value(each)}' for name, each in value.items())} }}"
    return f"[{', '.join(_value(each) for each in value)}]"


# ---- repairs: what a finding of `greybox data check` says to do with the map


@dataclass(frozen=True)
class Repair:
    """A change of the map that a finding asks for.

    Attributes
    ----------
    words : on its button.
    kind : sign, unit, exchange or clock.
    signals : whose.
    value : the unit, or the factor that time is divided by.
    """

    words: str
    kind: str
    signals: tuple[str, ...]
    value: Any = None


def repairs_of(sentence: str, channel: str) -> list[Repair]:
    """What a finding's sentence asks for, as buttons; nothing where it asks for nothing that a map can do."""
    head, _, rest = sentence.partition(": as mapped,")
    if not rest:
        return []
    named = tuple(_signals(head)) or ((channel,) if channel in SIGNALS else ())
    turned = re.search(r"Negate (.+?) in the column map", rest)
    if turned:
        signals = tuple(_signals(turned[1]))
        return [Repair(f"Negate {' and '.join(signals)}", "sign", signals)]
    unit = re.search(r'Set unit = "([^"]+)"', rest)
    if unit and named:
        return [Repair(f"Read {' and '.join(named)} in {unit[1]}", "unit", named, unit[1])]
    if ("other's column" in rest and len(named) >= 2) or ("IMU" in head and "other's column" in rest):
        pair = tuple(name for name in named if name != "yaw_rate")[:2] or ("a_x", "a_y")
        pair = pair if len(pair) == 2 else ("a_x", "a_y")
        also = re.search(r"turn the sign of ([\w ,]+)", rest)
        turning = tuple(_signals(also[1])) if also else ()
        words = f"Exchange {' and '.join(pair)}" + (f", turn {' and '.join(turning)}" if turning else "")
        return [Repair(words, "exchange", pair, turning)]
    clock = re.search(r"divide time by ([\d.e+-]+)", rest)
    if clock:
        factor = float(clock[1].rstrip("."))
        return [Repair(f"Divide time by {factor:g}", "clock", (), factor)]
    return []


def repaired(base: Mapping[str, Any], entries: Sequence[Entry], repair: Repair) -> tuple[dict[str, Any], list[Entry]]:
    """The map after a repair."""
    new = [dict(entry) for entry in entries]
    used = {entry["signal"]: entry for entry in new if entry["use"]}
    changed = dict(base)
    if repair.kind == "exchange":
        one, other = (used[name] for name in repair.signals)
        one["signal"], other["signal"] = other["signal"], one["signal"]
        used = {entry["signal"]: entry for entry in new if entry["use"]}
    turned = repair.value if repair.kind == "exchange" else repair.signals if repair.kind == "sign" else ()
    for name in turned:
        if name in used:
            used[name]["sign"] = -used[name]["sign"]
    if repair.kind == "unit":
        for name in repair.signals:
            if name in used:
                used[name].update(unit=repair.value, units=[])
    if repair.kind == "clock":
        time = dict(changed["time"])
        time["divide_by"] = time.get("divide_by", 1.0) * repair.value
        changed["time"] = time
    return changed, new


def _signals(text: str) -> Iterable[str]:
    return [word for word in re.findall(r"[a-z]\w*", text) if word in SIGNALS]
=======
    words = "# Made by greybox app; every command reads it: --columns map.toml\n"
    write_atomically(path, words + tomli_w.dumps(table_of(base, entries, extra or {})))
>>>>>>> main


def entries_of_map(path: Path) -> tuple[dict[str, Any], list[Entry]]:
    """Base and entries of a map that lies in a file, such as one that a person edited."""
    text = tomllib.loads(path.read_text("utf-8"))
    base = {key: value for key, value in text.items() if key not in ("name", "about", "source", "signals")}
    entries = [
        {
            "signal": name, "column": column.get("column", name), "unit": column["unit"], "units": [],
            "sign": int(column.get("sign", 1)), "divide_by": float(column.get("divide_by", 1.0)), "decided": True,
            "reasons": [], "use": True,
            "more": {key: value for key, value in column.items() if key not in ("column", "unit", "sign", "divide_by")},
        }
        for name, column in text.get("signals", {}).items()
    ]  # fmt: skip
    return base, entries
