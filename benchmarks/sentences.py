"""Collect what commands and reports print, and draw sentences of it for a reader.

    python benchmarks/sentences.py --out printed
    python benchmarks/sentences.py --out printed --draw 51 --to draw51.json

The first command runs the commands of `sentences.txt` and `--help` of every command in a temporary folder, and stores
each output whole, with the command at its top. Text of PDF files is stored too. The second command draws 100 printed
sentences, each with the file in which it stands: a reader marks those that are not clear at first reading.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import random
import re
import shlex
import sys
import tempfile
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any

import click
import numpy as np
from pypdf import PdfReader

import greybox_id as gb
from greybox_id.cli import greybox, main

COMMANDS = Path(__file__).with_suffix(".txt")
SAMPLE = 100
WORDS = 2
"""A shorter text is a name or a unit."""
WIDTH, HELP_WIDTH, GAP = 160, 98, 2
"""Characters of a line of output, of a line of help, and between columns."""
END = re.compile(r"(?<=[a-z)\]%”][.?!])\s+(?=[A-Z\"])")
"""Between two sentences."""
SPACES = {0xA0: " ", 0x202F: " "}
FULL = 85
"""Characters of a full line in a report; shorter ones are rows of tables, titles and numbers of figures."""
CELL = re.compile(r"\S+(?: \S+)*")
LABEL = re.compile(r"[A-Z][a-z]+(?: [a-z]+){1,6}")
WORD = re.compile(r"(?<![\w./-])[A-Za-z][a-z]+(?=$|[\s.,;:()?!-])")
NO_SENTENCE = re.compile(r"^(greybox|\S+\.(json|toml|csv)\b|.*\| greybox|Usage:|\$|import |from |--?\w)|[{}=]|\.\.\.$")
"""Lines of commands, of code and of options, and what --help cuts off."""


def recordings() -> None:
    """Write recordings to diagnose: of a 1:10 car, of a car that steers 60 ms late, and some that are spoilt."""
    racer = {name: gb.read(gb.datasets.shipped(name), columns="roboracer") for name in ("racer_train", "racer_valid")}
    lap = racer["racer_train"].rows(0, 600).to_pandas()
    lap.to_csv("lap.csv", index=False)
    racer["racer_valid"].rows(0, 400).to_pandas().to_csv("other.csv", index=False)
    lap.assign(yaw_rate=-lap["yaw_rate"]).to_csv("turned.csv", index=False)
    lap.assign(yaw_rate=np.degrees(lap["yaw_rate"])).to_csv("degrees.csv", index=False)
    lap.assign(a_x=lap["a_y"], a_y=lap["a_x"]).to_csv("swapped.csv", index=False)
    lap.assign(a_y=0.0).to_csv("constant.csv", index=False)
    lap.drop(columns=["steer"]).to_csv("no_steer.csv", index=False)
    lap.head(8).to_csv("short.csv", index=False)
    lap.iloc[::-1].to_csv("backwards.csv", index=False)
    lap.drop(index=range(200, 260)).to_csv("pause.csv", index=False)
    lap.assign(v_x=lap["v_x"].where(lap.index % 7 > 0)).to_csv("missing.csv", index=False)
    lap.rename(columns={"v_x": "Speed_kmh", "yaw_rate": "GyroZ", "steer": "SWA"}).assign(
        Speed_kmh=3.6 * lap["v_x"], GyroZ=np.degrees(lap["yaw_rate"])
    ).to_csv("logger.csv", index=False)
    truth = gb.models.lateral(vehicle="full_size_car") + gb.effects.steering_delay.at(0.06)
    for k, (name, rate, grip) in enumerate(
        (("late", 0.9, 1), ("later", 1.3, 1), ("latest", 1.1, 1), ("wet", 1.0, 0.6))
    ):
        time = np.arange(0.0, 20.0, 0.02)
        steer = 0.04 * np.sin(rate * time) * np.sin(0.21 * time) + 0.01 * np.sign(np.sin(2.3 * rate * time))
        inputs = gb.Recording(name, time, {"steer": steer, "v_x": 18.0 + 4.0 * np.sin(0.3 * time)})
        driven = truth if grip == 1 else truth + gb.effects.grip_scale.at(grip)
        table = inputs.with_signals(**gb.simulate(driven, inputs).signals).to_pandas()
        noise = np.random.default_rng(k).normal(0, [0.05, 0.01, 0.15], (len(time), 3))
        table[["v_y", "yaw_rate", "a_y"]] += noise
        table.to_csv(f"{name}.csv", index=False)
    Path("empty.csv").write_text("", encoding="utf-8")
    Path("words.csv").write_text("time,v_x\n0,fast\n1,slow\n", encoding="utf-8")
    Path("broken.toml").write_text("[signals\n", encoding="utf-8")
    Path("wrong_unit.toml").write_text('[signals.v_x]\ncolumn = "v_x"\nunit = "rad"\n', encoding="utf-8")
    Path("wrong_key.toml").write_text("[parameters.mass]\nvalue = 3\n", encoding="utf-8")
    Path("fleet.toml").write_text(
        'recordings = "{vehicle}.csv"\nvehicle = "full_size_car"\nsteps = ["check", "fit"]\n[fit]\nmodel = "lateral"\n'
        'set = {tyre = "linear"}\n'.replace("{vehicle}.csv", "lat*.csv"),
        encoding="utf-8",
    )


def every_help(command: click.Command, name: str) -> Iterator[str]:
    """`--help` of a command and of all commands below it."""
    yield f"{name} --help"
    if isinstance(command, click.Group):
        with click.Context(command) as context:
            for below in command.list_commands(context):
                found = command.get_command(context, below)
                if found is not None:
                    yield from every_help(found, f"{name} {below}")


def printed(line: str) -> str:
    """What a command prints, on both streams, and its exit code."""
    out = io.StringIO()
    before, sys.argv, code = sys.argv, shlex.split(line), 0
    try:
        with redirect_stdout(out), redirect_stderr(out):
            main()
    except SystemExit as end:
        code = int(end.code or 0)
    finally:
        sys.argv = before
    return f"$ {line}\n\n{out.getvalue()}\nexit code {code}\n"


def collect(folder: Path) -> None:
    """Run all commands in a temporary folder, and store each output and the text of each new PDF in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.txt"):
        old.unlink()
    lines = [line for line in COMMANDS.read_text(encoding="utf-8").splitlines() if line and line[0] != "#"]
    with tempfile.TemporaryDirectory() as place, chdir(place):
        recordings()
        seen: set[Path] = set()
        for k, line in enumerate((*every_help(greybox, "greybox"), *lines), 1):
            name = "_".join(word for word in re.findall(r"[a-z]\w*", line)[1:4])
            text = printed(line)
            (folder / f"{k:03}_{name}.txt").write_text(text.replace(place, "."), encoding="utf-8")
            for file in sorted(set(Path().rglob("*.pdf")) - seen):
                seen.add(file)
                pages = [page.extract_text() for page in PdfReader(file).pages]
                shown = f"{file}, written by $ {line}\n\n" + "\n\n".join(pages) + "\n"
                (folder / f"{k:03}_{name}_{file.stem}_pdf.txt").write_text(shown, encoding="utf-8")
            print(f"{k:03} {line}", flush=True)


def sentences(text: str) -> Iterator[str]:
    """Printed sentences and labels: wrapped lines of a paragraph or of a cell are joined, cells are separate."""
    width = HELP_WIDTH if "Usage:" in text else WIDTH
    rows: list[dict[int, str]] = []
    ends: dict[int, int] = {}
    for line in text.translate(SPACES).replace("  [", " [").splitlines()[1:]:
        cells = {found.start(): found.group() for found in CELL.finditer(line)}
        places = [*sorted(ends), width + GAP]
        room = {at: places[places.index(at) + 1] - GAP for at in ends}
        inside = bool(ends) and set(cells) <= set(ends) and (len(ends) == 1 or min(cells, default=0) > min(ends))
        full = any(ends[at] <= room[at] < ends[at] + 1 + len(cells[at].split()[0]) for at in cells if inside)
        if full:
            rows[-1] |= {at: f"{rows[-1][at]} {words}".replace("- ", "-") for at, words in cells.items()}
            ends |= {at: at + len(words) for at, words in cells.items()}
        else:
            rows.append(cells)
            ends = {at: at + len(words) for at, words in cells.items()}
    for row in rows:
        for words in row.values():
            yield from re.split(END, words)


def pdf_sentences(text: str) -> Iterator[str]:
    """Whole sentences of a report, and lines of a few words: the rest of figures and tables has no order in a PDF."""
    paragraphs, before = [""], ""
    for line in text.translate(SPACES).splitlines()[1:]:
        if LABEL.fullmatch(line):
            yield line
        if len(before) >= FULL:
            paragraphs[-1] += f" {line}"
        elif len(line) >= FULL:
            paragraphs.append(line)
        before = line
    for paragraph in paragraphs:
        for one in re.split(END, paragraph):
            if one[:1].isupper() and one[-1:] in ".?!" and not re.search("[a-z]- [a-z]", one):
                yield " ".join(one.split())


def draw(folder: Path, seed: int) -> list[dict[str, Any]]:
    """Draw sentences at random, each with its file; sentences that differ in numbers only count once."""
    where: dict[str, tuple[str, str]] = {}
    for file in sorted(folder.glob("*.txt")):
        read = pdf_sentences if file.stem.endswith("_pdf") else sentences
        for one in read(file.read_text(encoding="utf-8")):
            if len(WORD.findall(one)) >= WORDS and not NO_SENTENCE.search(one):
                where.setdefault(re.sub(r"\d[\d.]*", "0", one), (one, file.name))
    picked = random.Random(seed).sample(sorted(where), min(SAMPLE, len(where)))
    return [{"number": k, "sentence": where[one][0], "file": where[one][1]} for k, one in enumerate(picked, 1)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the outputs")
    parser.add_argument("--draw", type=int, metavar="SEED", help="draw sentences of the folder instead of collecting")
    parser.add_argument("--to", type=Path, help="file of the draw; without it, standard output")
    chosen = parser.parse_args()
    if chosen.draw is None:
        os.environ.setdefault("COLUMNS", "120")
        collect(chosen.out.resolve())
    else:
        drawn = json.dumps(draw(chosen.out, chosen.draw), indent=1, ensure_ascii=False) + "\n"
        with suppress(BrokenPipeError):
            _ = chosen.to.write_text(drawn, encoding="utf-8") if chosen.to else sys.stdout.write(drawn)
