"""On a full disk every command that writes ends in a sentence and leaves what was there."""

import resource
import subprocess
import sys

import pytest

from greybox_id.datasets.formats import WRITTEN
from greybox_id.export.verb import TARGETS

ROOM = 1024
"""Bytes that a file may have in the process that finds the disk full."""
CALLS = {
    "predict": "predict {fit} {lap} --out {out}/table.csv",
    "simulate to parquet": "simulate {fit} {lap} --out {out}/table.parquet",
    "profile": "profile {fit} --all --out {out}/table.csv",
    "track": "track {lap} --vehicle {car} --model lateral --tune 0s --out {out}/table.csv --figures {out}",
    "report": "report {fit} --out {out}/report.html",
    "report as pdf": "report {fit} --out {out}/report.pdf",
    "fit": "fit --model lateral --vehicle {car} --horizon 1 --solver gauss-newton {lap} --out {out}",
    "data map": "data map {lap} --out {out}/map.toml --overwrite",
    "make": "datasets make virtual_lap --out {out} --overwrite",
    **{f"convert to {end}": f"data convert {{lap}} --out {{out}}/lap{end} --overwrite" for end in WRITTEN},
    **{f"export to {target}": f"export {{fit}} --target {target} --out {{out}}/car" for target in TARGETS},
}


pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.fixture(scope="module")
def files(tmp_path_factory, made_files):
    return made_files(tmp_path_factory.mktemp("read"))


def run(call, room=None):
    """Exit code and standard error of a command in a process of its own, which begins and ends as processes do."""

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, resource.RLIM_INFINITY))

    done = subprocess.run(
        [sys.executable, "-c", "from greybox_id.cli import main; main()", *call.split()],
        capture_output=True, text=True, timeout=300, check=False, preexec_fn=limit if room is not None else None,
    )  # fmt: skip
    return done.returncode, done.stderr[:4000]


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the harness forks")
@pytest.mark.parametrize("name", CALLS)
def test_a_full_disk_leaves_what_was_there(name, files, tmp_path):
    out = tmp_path / "out"
    call = CALLS[name].format(out=out, **files)
    code, said = run(call)
    if "not installed" in said:
        pytest.skip(said)
    assert code == 0, said
    before = {file: file.read_bytes() for file in out.rglob("*") if file.is_file()}
    assert any(len(content) > ROOM for content in before.values())
    code, said = run(call, room=ROOM)
    assert code == 2, said
    assert "File too large" in said
    assert "Traceback" not in said
    assert {file: file.read_bytes() for file in out.rglob("*") if file.is_file()} == before
