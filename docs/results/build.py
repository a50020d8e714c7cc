"""The pages of results from the JSON beside this file; `--run NAME OPTIONS...` measures a bench again, keeps its JSON.

`python docs/results/build.py` writes the pages, `--check` exits with 1 where one is not current.
The first digit of a file's name says on which page it is.
A file is either a table as its script printed it, or what `greybox bench NAME --json` printed, with when and with what.
"""

from __future__ import annotations

import argparse
import datetime
import json
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

from greybox_id.base.numbers import number
from greybox_id.base.version import __version__

HERE = Path(__file__).parent
HEADS = {
    "results": """# Results

This page shows what was measured, and the commands that repeat the measurement. The line below a table gives date,
version, seed and number of cases (n). `DIR` is the folder with the recordings of other authors (`greybox datasets
list`). CPU seconds are those of one core at 3.1 GHz. A bar is a requirement that was set for a figure; bars that were
missed are marked. The [decision notes](decisions/README.md) say what was tried without success.

This page is about the diagnosis. Other pages: [recordings of others](results_recordings.md), [intervals, verdicts and
designed manoeuvres](results_uncertainty.md), [speed, sizes and damage](results_speed.md).
""",
    "results_recordings": """# Results on recordings of others

The data and baselines on this page were published by other authors. [Results](results.md) says how to read the tables.
""",
    "results_uncertainty": """# Results: intervals, verdicts, designed manoeuvres

[Results](results.md) says how to read the tables.
""",
    "results_speed": """# Results: speed, sizes, damage

[Results](results.md) says how to read the tables.
""",
}
"""Of each page, in the order of the first digits of files."""
MOST_TASKS = 1
"""A bench with more shows the first one alone; the file has all."""
STAYS = ("title", "commands", "about", "answer")
"""Of a bench's file, when it is measured again; the first answer is shown where `answer` is true."""


def pages() -> dict[Path, str]:
    """Every page and its text."""
    result = {}
    for digit, (name, head) in enumerate(HEADS.items(), 1):
        parts = [head]
        for file in sorted(HERE.glob(f"{digit}*.json")):
            kept = json.loads(file.read_text(encoding="utf-8"))
            parts.append(section(of_bench(kept) if "result" in kept else kept))
        result[HERE.parent / f"{name}.md"] = "\n".join(parts)
    return result


def section(kept: dict[str, Any]) -> str:
    """One section: what was done, commands, table."""
    measured = kept["measured"]
    seed = "" if measured["seed"] == "none" else f", seed {measured['seed']}"
    said = f"{measured['date']}, version {measured['version']}{seed}, n: {measured['n']}"
    lines = [f"## {kept['title']}", "", kept["about"], "", *(f"    {command}" for command in kept["commands"]), ""]
    lines += [row(kept["columns"]), "|-" * len(kept["columns"]) + "|", *map(row, kept["rows"]), "", said]
    return "\n".join([*lines, *(["", kept["after"]] if kept.get("after") else []), ""])


def row(cells: list[str]) -> str:
    """One line of a table."""
    return f"| {' | '.join(str(cell) for cell in cells)} |"


def of_bench(kept: dict[str, Any]) -> dict[str, Any]:
    """What a bench printed, as a section: a row for each model, a column for each task."""
    rows = kept["result"]["rows"]
    tasks = list(dict.fromkeys(one["task"] for one in rows))
    shown = tasks if len(tasks) <= MOST_TASKS else tasks[:1]
    models = dict.fromkeys((one["model"], one["published"], one["parameters"]) for one in rows if one["task"] in shown)
    columns, cells = ["model", *(f"{task} [{_of(rows, task)[0]['unit']}]" for task in shown), "CPU s"], []
    for model, published, parameters in models:
        same = [
            one for one in rows if (one["model"], one["published"], one["parameters"]) == (model, published, parameters)
        ]
        spent = next((one["cpu_seconds"] for one in same if one["cpu_seconds"] is not None), None)
        values = [_value(_of(same, task)) for task in shown]
        name = f"{model}, {parameters} parameters (published)" if published else model
        cells.append([name, *values, "–" if spent is None else number(spent, 2)])
    answer = re.split(r"(?<=\.) (?=[A-Z])", kept["result"]["answers"][0])[0] if kept.get("answer") else ""
    return {**kept, "columns": columns, "rows": cells, "after": answer}


def _of(rows: list[dict[str, Any]], task: str) -> list[dict[str, Any]]:
    return [one for one in rows if one["task"] == task]


def _value(rows: list[dict[str, Any]]) -> str:
    if not rows:
        return "–"
    spread = rows[0]["spread"]
    return number(rows[0]["value"], 3) + ("" if spread is None else f" ± {number(spread, 2)}")


def run(name: str, options: list[str]) -> None:
    """Measure a bench again, and keep what it prints beside its title."""
    file = next(HERE.glob(f"*_{name}.json"))
    before = json.loads(file.read_text(encoding="utf-8"))
    command = ["greybox", "bench", name, *options]
    done = subprocess.run(
        [sys.executable, "-c", "from greybox_id.cli import main; main()", *command[1:], "--json"],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    keep(file, before, json.loads(done.stdout))


def keep(file: Path, before: dict[str, Any], result: dict[str, Any]) -> None:
    """Write a bench's file: title, commands and words stay, what was measured is new."""
    measured = {
        "date": datetime.date.today().isoformat(),
        "version": __version__,
        "casadi": version("casadi"),
        "numpy": version("numpy"),
        "seed": before["measured"]["seed"],
        "n": before["measured"]["n"],
    }
    kept = {**{name: before[name] for name in STAYS if name in before}, "measured": measured, "result": result}
    file.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def main() -> int:
    """Write, check or measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="exit with 1 where a page is not current")
    parser.add_argument("--run", nargs=argparse.REMAINDER, help="a bench with its options, to be measured again")
    words = parser.parse_args()
    if words.run:
        run(words.run[0], words.run[1:])
    if words.check:
        return 0 if all(page.read_text(encoding="utf-8") == text for page, text in pages().items()) else 1
    for page, text in pages().items():
        page.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
