"""Texts that others chose end nothing in generated code: names of files and vehicles are tried against every target."""

import ast
import json
import subprocess

import pytest
import yaml

from greybox_id.export.c.naming import c_comment, c_string, docstring, one_line, yaml_text
from greybox_id.export.subject import Subject
from greybox_id.export.verb import export
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

HOSTILE = [
    "a*\\ int injected = 1; \\* .toml",
    "*/ int injected = 1; /*",
    "**//**/ int injected;",
    "/*/ int injected;",
    "??/\n int injected; //",
    "\\",
    "\\\n*/ int injected;",
    '"""\nimport os\nos.environ["X"] = "1"\n"""',
    '""""',
    '\\"""\ninjected = 1\n"""',
    "a\\",
    "car\nm: 99999\n",
    "car\rm: 99999",
    "car\u2028m: 99999",
    "car\x85m: 99999",
    "car\x1b[2J\x00\x7f",
    "${injected} {injected} %s %n",
    "#if 0\n",
    "车 🚗 é",
]
TARGETS = ["c", "casadi", "acados", "f1tenth"]


def exported(target, source, folder):
    """File -> what is left of it without comments and docstrings."""
    subject = Subject(build("lateral", {"tyre": "linear"}, vehicle=vehicle("roboracer")), "car", source=source)
    return {file.name: meant(file) for file in export(subject, target, folder) if file.name != "manifest.json"}


def meant(file):
    text = file.read_text("utf-8")
    if file.suffix in (".c", ".h"):
        return subprocess.run(
            ["cc", "-fpreprocessed", "-dD", "-E", "-P", "-x", "c", "-"], input=text, capture_output=True, text=True,
            check=True,
        ).stdout  # fmt: skip
    if file.suffix == ".py":
        tree = ast.parse(text)
        assert isinstance(tree.body.pop(0).value.value, str)
        return ast.dump(tree)
    if file.suffix in (".yaml", ".txt") and file.name != "CMakeLists.txt":
        return yaml.safe_load(text)
    return None if file.suffix == ".md" else text


@pytest.mark.slow
@pytest.mark.parametrize("target", TARGETS)
def test_no_name_of_a_vehicle_or_file_changes_what_is_exported(target, tmp_path):
    harmless = exported(target, "car.toml", tmp_path / "harmless")
    for k, source in enumerate(HOSTILE):
        assert exported(target, source, tmp_path / str(k)) == harmless, source
        manifest = json.loads((tmp_path / str(k) / "manifest.json").read_text("utf-8"))
        assert manifest["source"] == source


@pytest.mark.parametrize("text", HOSTILE)
def test_each_language_reads_a_text_back_as_one(text, tmp_path):
    assert "\n" not in one_line(text)
    inside = c_comment(text)
    assert not {"*/", "/*", "\n", "\\", "??"} & {inside[k : k + n] for k in range(len(inside)) for n in (1, 2)}
    assert ast.literal_eval(f'"""{docstring(text)}."""') == f"{one_line(text)}."
    assert yaml.safe_load(f"key: {yaml_text(text)}\nother: 1") == {"key": one_line(text), "other": 1}
    program = tmp_path / "said.c"
    program.write_text(f"#include <stdio.h>\nint main(void) {{ /* {inside} */ fputs({c_string(text)}, stdout); }}\n")
    subprocess.run(["cc", "-std=c99", "-trigraphs", "-w", program, "-o", tmp_path / "said"], check=True)
    assert subprocess.run([tmp_path / "said"], capture_output=True, check=True).stdout.decode() == one_line(text)


@pytest.mark.parametrize("word", ["yes", "No", "null", "true", "on", "off", "1e3", "0x10", "", "a: b", "- a", "~"])
def test_a_word_that_yaml_takes_for_something_else_is_quoted(word):
    assert yaml.safe_load(f"key: {yaml_text(word)}") == {"key": word}
