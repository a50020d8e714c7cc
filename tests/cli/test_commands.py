"""The command line as a whole: its help, what was meant by a slip, and what a shell completes."""

import os
import re
import shutil
import subprocess
import sys

import click
import pytest
from calling import greybox, refused
from click.shell_completion import ShellComplete

from greybox_id.cli import greybox as root
from greybox_id.cli.commands import groups


def commands(group=root, words=()):
    """Every command with the words that call it, groups included."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        yield (*words, name), command
        if isinstance(command, click.Group):
            yield from commands(command, (*words, name))


ALL = dict(commands())


def completions(*words):
    *before, incomplete = words
    return [item.value for item in ShellComplete(root, {}, "greybox", "_").get_completions(before, incomplete)]


def test_help_lists_every_command_under_its_heading():
    told = greybox("--help").out
    headings = [line[:-1] for line in told.splitlines() if line.endswith(":") and not line.startswith(" ")]
    assert headings == ["Options", *groups()]
    for name, (_, about) in (entry for commands in groups().values() for entry in commands.items()):
        assert f"  {name} " in told
        assert about in " ".join(told.split())


@pytest.mark.parametrize("words", list(ALL), ids=" ".join)
def test_every_command_shows_an_example(words):
    told = greybox(*words, "--help").out
    assert told.startswith(f"Usage: greybox {' '.join(words)} ")
    assert re.search(rf"^  greybox {' '.join(words)}( |$)", told, re.MULTILINE)


def test_options_of_one_name_are_alike_everywhere():
    shared = {}
    for words, command in ALL.items():
        for option in (own for own in command.params if isinstance(own, click.Option)):
            for name in option.opts:
                if name in ("--json", "--seed", "--jobs", "--columns", "--out"):
                    shared.setdefault(name, {})[words] = option
        leaf = not isinstance(command, click.Group)
        assert ("--json" in {name for own in command.params for name in own.opts}) == (
            leaf and words != ("completion",)
        )
    assert {own.is_flag for own in shared["--json"].values()} == {True}
    for name in ("--seed", "--jobs"):
        assert {type(own.type) for own in shared[name].values()} == {click.IntRange}
    assert {option.metavar for option in shared["--columns"].values()} == {"MAP"}
    assert {own.metavar for own in shared["--out"].values()} == {"FILE", "FOLDER", "MAP.toml"}


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["fitt"], "Did you mean fit?"),
        (["data", "chek"], "Did you mean check?"),
        (["exam", "mak"], "Did you mean make?"),
        (["datasets", "xyz"], "Possible names: fetch, list, make."),
        (["fit", "--colums", "x"], "--columns"),
        (["export", "--vehicle", "truck", "--target", "casdi", "--out", "car"], "Did you mean casadi?"),
        (["models", "--vehicle", "ferari", "single_track"], "Did you mean ferrari_250lm?"),
        (
            ["fit", "--model", "lateral", "--vehicle", "truck", "--with", "steering_dely", "x"],
            "Did you mean steering_d",
        ),
    ],
)
def test_a_slip_is_answered_with_what_was_meant(words, meant, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert meant in refused(*words)


def test_files_that_are_not_there_are_answered_with_those_that_are(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    for name in ("lap7.csv", "my_car.toml", "run/fit.json"):
        (tmp_path / name).touch()
    assert "Did you mean lap7.csv?" in refused("data", "check", "lab7.csv")
    assert "Did you mean my_car.toml?" in refused("data", "check", "lap7.csv", "--columns", "mycar.toml")
    assert "Did you mean my_car.toml?" in refused("data", "check", "lap7.csv", "--columns", "my_car")
    assert "Did you mean my_car.toml?" in refused("models", "lateral", "--vehicle", "my_cra.toml")
    assert "Did you mean run/fit.json?" in refused("validate", "run/fits.json", "lap7.csv")
    assert "There is no folder runs." in refused("validate", "runs/fit.json", "lap7.csv")
    assert "Did you mean run/fit.json?" in refused("import", "run/fti.json")


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["val"], ["validate"]),
        (["data", "c"], ["check", "convert"]),
        (["fit", "--model", "l"], ["lateral", "longitudinal"]),
        (["fit", "--with", "steering_d"], ["steering_delay"]),
        (["fit", "--vehicle", "f"], ["ferrari_250lm", "full_size_car", "field.toml"]),
        (["data", "check", "--columns", "fi"], ["field.toml"]),
        (["export", "--target", "ca"], ["casadi"]),
        (["datasets", "make", "v"], ["virtual_lap"]),
        (["effects", "steering_la"], ["steering_lag"]),
    ],
)
def test_a_shell_completes_names(words, found, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "field.toml").touch()
    assert set(completions(*words)) == set(found)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_a_shell_is_one_it_can_read(shell, tmp_path):
    script = greybox("completion", shell).out
    assert "_GREYBOX_COMPLETE" in script
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    (tmp_path / "script").write_text(script)
    subprocess.run([shell, "-n", tmp_path / "script"], check=True)


ASKS = {
    "bash": "source ./script; COMP_WORDS=({words}); COMP_CWORD={last}; _greybox_completion greybox; "
    "echo ${{COMPREPLY[@]}}",
    "zsh": "source ./script; compadd() {{ print -r -- $completions }}; words=({words}); CURRENT={last}+1; "
    "_greybox_completion",
    "fish": "source ./script; complete -C'{words}'",
}


@pytest.mark.slow
@pytest.mark.parametrize("shell", ASKS)
def test_a_shell_with_its_script_completes_models_effects_and_column_maps(shell, tmp_path):
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    (tmp_path / "script").write_text(greybox("completion", shell).out)
    (tmp_path / "greybox").write_text(f"#!{sys.executable}\nfrom greybox_id.cli import main\n\nmain()\n")
    (tmp_path / "greybox").chmod(0o755)
    asked = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}", "HOME": str(tmp_path)}
    asked["PYTHONPATH"] = os.pathsep.join(sys.path)
    for words, found in (
        ("greybox fit --model l", ["lateral", "longitudinal"]),
        ("greybox fit --with steering_d", ["steering_delay"]),
        ("greybox data check --columns r", ["revs_250lm", "roboracer"]),
    ):
        line = ASKS[shell].format(words=words, last=len(words.split()) - 1)
        called = subprocess.run(
            [shell, "-c", line], cwd=tmp_path, env=asked, capture_output=True, text=True, check=False
        )
        assert (called.stdout.split(), called.stderr) == (found, ""), words


def test_a_shell_that_is_not_known_is_refused():
    assert "'bash', 'zsh', 'fish'" in refused("completion", "tcsh")


def test_completing_a_command_loads_none():
    code = "import sys; from greybox_id.cli import main\ntry: main()\nfinally: print('numpy' in sys.modules)"
    asked = {**os.environ, "_GREYBOX_COMPLETE": "bash_complete", "COMP_WORDS": "greybox da", "COMP_CWORD": "1"}
    called = subprocess.run([sys.executable, "-c", code], env=asked, capture_output=True, text=True, check=True)
    assert called.stdout.split() == ["plain,data", "plain,datasets", "False"]


@pytest.mark.parametrize("word", ["nan", "inf", "-inf"])
def test_no_option_takes_what_is_no_number(word):
    options = [
        (words, own) for words, command in commands() for own in command.params
        if isinstance(own.type, click.types.FloatParamType)
    ]  # fmt: skip
    assert len(options) > 10
    for words, own in options:
        with pytest.raises(click.BadParameter, match=r"finite number|not in the range"):
            pytest.fail(f"{words} {own.opts}: {own.type.convert(word, own, None)}")
    assert "finite number" in refused("predict", "fit.json", "lap.csv", "--horizon", "nan")
