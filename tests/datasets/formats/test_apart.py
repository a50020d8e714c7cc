"""A reader in a process of its own: what ends it, or takes too long or too much, is a sentence, and nothing is left."""

import gzip
import os
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.formats.apart import Apart, Limits
from greybox_id.datasets.read import read

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals and limits are those of POSIX")
DAMAGED = Path(__file__).parent / "damaged"
TIGHT = Limits(seconds=1, memory=2e8, patience=30)
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="only Linux holds a process to its memory")


@pytest.fixture
def file(tmp_path, monkeypatch):
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "lap.strange").write_bytes(b"strange")
    return tmp_path / "lap.strange"


def strange(file, limits=TIGHT):
    return Apart(file, "strange_readers:Reader", "strange", "strange", limits)


def ended(process):
    """Whether a process is gone."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    return False


def test_answers_come_back_one_after_the_other(file):
    reader = strange(file)
    for of in ([], [1, "größe", None, [2.5]], ["\udc80"]):
        assert reader.answer("echo", *of) == {"of": of, "file": str(file)}
    assert reader.answer("print") == "heard"
    assert reader.answer("echo") == {"of": [], "file": str(file)}


def test_arrays_come_back_bit_by_bit(file):
    reader = strange(file)
    for dtype in ("<f8", ">f8", "<f2", "|b1", ">u8", "<c16", "|S5", "<U3", "<M8[ns]"):
        for shape in ([3], [2, 5], [0], []):
            found = reader.array("array", dtype, shape)
            made = np.arange(int(np.prod(shape)) * np.dtype(dtype).itemsize, dtype=np.uint8)
            assert (found.dtype, found.shape) == (np.dtype(dtype), tuple(shape))
            assert found.tobytes() == made.tobytes()


@pytest.mark.parametrize(
    ("question", "of", "sentence"),
    [
        ("crash", [], "lap.strange is damaged: reading it ended in SIGSEGV; restore it or export it again"),
        ("is_killed", ["SIGABRT"], "ended in SIGABRT"),
        (
            "is_killed",
            ["SIGKILL"],
            r"another program, or the system, ended the process that read it \(SIGKILL\). Free memory and try again",
        ),
        ("spin", [], "too large: reading it took more than 1 s;"),
        ("gabble", [], "is damaged: reading it ended in nonsense"),
        ("gives", [], r"not a sound strange file \(.*data-type"),
        ("fails", ["length -1\nand more"], r"not a sound strange file \(length -1\)"),
        ("needs", [], r"needs nothing_of_this_name, which is not installed; pip install 'greybox-id\[strange\]'"),
        ("nothing", [], "not a sound strange file"),
        pytest.param("eat", [], "too large: reading it took more than 0.2 GB of memory", marks=LINUX),
        pytest.param("eat_unnoticed", [], "too large: reading it took more than 0.2 GB of memory", marks=LINUX),
    ],
)
def test_whatever_ends_a_reader_is_a_sentence_and_leaves_no_file(file, question, of, sentence):
    reader = strange(file)
    with pytest.raises(BadInput, match=sentence):
        reader.answer(question, *of)
    del reader
    assert sorted(path.name for path in file.parent.rglob("*")) == ["lap.strange", "temporary"]


def test_a_reader_that_hangs_is_ended(file):
    reader = strange(file, Limits(seconds=50, memory=2e8, patience=2))
    with pytest.raises(BadInput, match="reading it took more than 2 s"):
        reader.answer("hang")
    assert ended(int(file.read_text()))
    with pytest.raises(BadInput, match="could not be read before"):
        reader.answer("echo")


def test_an_interrupt_ends_the_reader(file):
    reader = strange(file, Limits(seconds=50, memory=2e8, patience=50))

    def interrupt():
        while not (file.read_bytes() or b"s")[:1].isdigit():
            time.sleep(0.01)
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        reader.answer("hang")
    assert ended(int(file.read_text()))


def test_a_reader_ends_when_nobody_remembers_it(file):
    reader = strange(file)
    process = reader.answer("own_id")
    assert not ended(process)
    del reader
    assert ended(process)


def test_a_reader_starts_without_what_it_does_not_need(tmp_path):
    reader = Apart(tmp_path, "strange_readers:Reader", "strange", "strange", TIGHT)
    loaded = {name.partition(".")[0] for name in reader.answer("modules")}
    assert "numpy" in loaded
    assert not loaded & {"casadi", "matplotlib", "pandas", "scipy", "pint"}
    own = {name for name in reader.answer("modules") if name.startswith("greybox_id")}
    assert own <= {
        "greybox_id", "greybox_id.base", "greybox_id.base.contained", "greybox_id.base.contained.inside",
        "greybox_id.base.version", "greybox_id.export", "greybox_id.models",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("damaged", "header"),
    [
        ("attribute.h5", b""),
        ("attribute.h5", b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(384)),
        ("master.mf4", b""),
        ("another_master.mf4", b""),
    ],
)
def test_files_that_crash_their_library_are_told(tmp_path, damaged, header):
    file = tmp_path / damaged
    file.write_bytes(header + gzip.decompress((DAMAGED / f"{damaged}.gz").read_bytes()))
    with pytest.raises(BadInput, match=r"is damaged: reading it ended in|is not a sound"):
        read(file)
