"""Fetching from a server of our own: whole, interrupted, changed, gone."""

import hashlib
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from calling import greybox, refused

from greybox_id.base.errors import BadInput
from greybox_id.datasets.public import ATTEMPTS, HASHES, PUBLIC, PublicDataset, Remote, fetch

CONTENT = b"".join(b"%d,%d\n" % (k, k * k) for k in range(40_000))
SHA = hashlib.sha256(CONTENT).hexdigest()


class _Server(ThreadingHTTPServer):
    def __init__(self):
        super().__init__(("127.0.0.1", 0), _Handler)
        self.files = {"/lap.csv": CONTENT}
        self.breaks_off_after = []  # bytes of an answer's body, one number for each answer to come
        self.ranges = True
        self.asked = []

    @property
    def address(self):
        return f"http://127.0.0.1:{self.server_port}"


class _Handler(BaseHTTPRequestHandler):
    def do_GET(self):
        wanted = self.headers.get("Range")
        self.server.asked.append((self.path, wanted))
        content = self.server.files.get(self.path)
        if content is None:
            self.send_error(404)
            return
        start = int(wanted[6:-1]) if wanted and self.server.ranges else 0
        if start >= len(content):
            self.send_error(416)
            return
        body = content[start:]
        self.send_response(206 if start else 200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.server.breaks_off_after:
            body = body[: self.server.breaks_off_after.pop(0)]
        self.wfile.write(body)

    def log_message(self, *_):
        pass


@pytest.fixture
def server():
    with _Server() as own:
        threading.Thread(target=own.serve_forever, daemon=True).start()
        yield own
        own.shutdown()


def dataset(server, sha=SHA, **changes):
    files = (Remote("lap.csv", f"{server.address}/lap.csv", sha),)
    described = {"name": "own", "about": "", "source": "here", "licence": "", "reference": "", "columns": "canonical"}
    return PublicDataset(**{**described, "files": files, **changes})


def test_a_file_is_fetched_once(server, tmp_path):
    (path,) = fetch(dataset(server), tmp_path)
    assert path.read_bytes() == CONTENT
    fetch(dataset(server), tmp_path)
    assert len(server.asked) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["lap.csv"]


@pytest.mark.parametrize("ranges", [True, False])
def test_a_transfer_that_breaks_off_is_taken_up_again(server, tmp_path, ranges):
    server.breaks_off_after, server.ranges = [100_000, 50_000], ranges
    (path,) = fetch(dataset(server), tmp_path)
    assert path.read_bytes() == CONTENT
    if ranges:
        assert [own for _, own in server.asked] == [None, "bytes=100000-", "bytes=150000-"]


def test_what_came_is_kept_for_the_next_call(server, tmp_path):
    server.breaks_off_after = [1000] * ATTEMPTS
    with pytest.raises(BadInput, match="broke off 5 times"):
        fetch(dataset(server), tmp_path)
    assert (tmp_path / "lap.csv.part").stat().st_size == 5000
    assert not (tmp_path / "lap.csv").exists()
    assert fetch(dataset(server), tmp_path)[0].read_bytes() == CONTENT
    assert server.asked[-1][1] == "bytes=5000-"


def test_another_file_than_the_known_one_is_not_kept(server, tmp_path):
    server.files["/lap.csv"] = CONTENT[:-1] + b"x"
    with pytest.raises(BadInput, match="is not the expected file"):
        fetch(dataset(server), tmp_path)
    assert not list(tmp_path.iterdir())


def test_an_unknown_hash_is_written_down_and_compared_later(server, tmp_path):
    fetch(dataset(server, sha=""), tmp_path)
    assert SHA in (tmp_path / HASHES).read_text()
    (tmp_path / "lap.csv").write_bytes(b"spoiled")
    server.files["/lap.csv"] = CONTENT + b"more"
    with pytest.raises(BadInput, match=SHA):
        fetch(dataset(server, sha=""), tmp_path)
    server.files["/lap.csv"] = CONTENT
    assert fetch(dataset(server, sha=""), tmp_path)[0].read_bytes() == CONTENT


def test_columns_in_files_of_their_own_become_one_recording(server, tmp_path):
    server.files |= {"/t.txt": b"0\n0.1\n0.2\n", "/vx.txt": b"1\n2\n3\n"}
    files = tuple(Remote(f"{name}.txt", f"{server.address}/{name}.txt") for name in ("t", "vx"))
    (path,) = fetch(dataset(server, files=files, joined="run.csv"), tmp_path)
    assert path.name == "run.csv"
    np.testing.assert_array_equal(np.loadtxt(path, delimiter=",", skiprows=1), [[0, 1], [0.1, 2], [0.2, 3]])


def test_gone_offline_and_by_hand_are_sentences(server, tmp_path):
    server.files.clear()
    with pytest.raises(BadInput, match="answers 404 Not Found; has it moved"):
        fetch(dataset(server), tmp_path)
    nowhere = (Remote("lap.csv", "http://127.0.0.1:9/lap.csv"),)
    with pytest.raises(BadInput, match=r"cannot be reached.*online"):
        fetch(dataset(server, files=nowhere), tmp_path)
    with pytest.raises(BadInput, match="yourself and read them with columns truck"):
        fetch(PUBLIC["truck"], tmp_path)


def test_the_command_tells_where_the_files_are_and_what_is_next(server, tmp_path, monkeypatch):
    monkeypatch.setitem(PUBLIC, "own", dataset(server))
    monkeypatch.setenv("GREYBOX_CACHE", str(tmp_path))
    called = greybox("datasets", "fetch", "own")
    assert str(tmp_path / "datasets" / "own" / "lap.csv") in called.out
    assert "greybox data check" in called.out
    assert "MB" in called.err
    (listed,) = [own for own in greybox("datasets", "list", "--json").told["public"] if own["name"] == "own"]
    assert listed["cached"]
    assert "Did you mean roboracer?" in refused("datasets", "fetch", "robracer")


def test_known_hashes_are_those_of_the_files_at_hand(real_data):
    for name, held in (("roboracer", "roboracer"),):
        for remote in PUBLIC[name].files:
            if remote.sha256:
                assert hashlib.sha256((real_data / held / remote.name).read_bytes()).hexdigest() == remote.sha256
