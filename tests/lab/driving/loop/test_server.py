"""A server answers what is wrong by a status and a sentence, changes nothing then, and loses nothing by a kill."""

import contextlib
import gzip
import http.client
import io
import json
import random
import secrets
import shutil
import socket
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import urlsplit

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from calling import refused
from hostile_mutations import mutated
from serving import TOKEN, serving

from greybox_id.base.errors import BadInput
from greybox_lab.driving.loop.client import Client
from greybox_lab.driving.loop.protocol import (
    CHALLENGE,
    DIGEST,
    LARGEST,
    LARGEST_TEXT,
    NONCE,
    SIGNATURE,
    Declined,
    digest_of,
    read_token,
    signature,
)  # fmt: skip
from greybox_lab.driving.loop.scene import Scene
from greybox_lab.driving.loop.server import listening
from greybox_lab.driving.loop.store import QUEUED, TRAINING
from greybox_lab.driving.racing.learner import shipped_learned
from greybox_lab.driving.racing.policy import Policy

SCENE = Scene(1)


@pytest.fixture(scope="module")
def rows():
    """Bytes of 8 s of driving as of geometry alone: it is not looked at whether a car could."""
    time = 0.02 * np.arange(400)
    steer, v_x = 0.1 * np.sin(time), 3.0 + 0.5 * np.sin(0.3 * time)
    yaw_rate = v_x * steer / 0.32
    signals = {"v_x": v_x, "yaw_rate": yaw_rate, "a_y": v_x * yaw_rate, "steer": steer, "drive_force": 0.1 * steer}
    return pd.DataFrame({"time": time, **signals}).to_csv(index=False, float_format="%.6g").encode()


@pytest.fixture(scope="module")
def policy():
    return shipped_learned().text().encode()


@pytest.fixture(scope="module")
def server(tmp_path_factory, policy):
    """A server that knows a policy and the session `car`."""
    with serving(tmp_path_factory.mktemp("server")) as own:
        begun(own.client, policy)
        yield own


@pytest.fixture
def known(server, rows, tmp_path):
    """A folder whose server will know a policy, the session `car` and its rows, without asking for them."""
    for name in ("policies", "sessions", "store.json"):
        source, target = server.folder / name, tmp_path / "state" / name
        shutil.copytree(source, target) if source.is_dir() else shutil.copy(source, target.parent)
    place = tmp_path / "state" / "sessions" / "car" / "rows"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    (place / f"{digest_of(rows)}.csv").write_bytes(rows)
    return tmp_path


def begun(client, policy):
    sha = client.post("/v1/policies", policy)["sha256"]
    client.post("/v1/hello", {"session": "car", "vehicle": SCENE.text, "policy": sha})
    return sha


def state(server):
    """Everything on disk but what is under way."""
    return {
        str(path.relative_to(server.folder)): path.read_bytes()
        for path in server.folder.rglob("*")
        if path.is_file() and not path.name.startswith(".greybox-")
    }


def sent(server, raw, wait=15.0):
    """Status and sentence of the answer to bytes as they are."""
    parts = urlsplit(server.address)
    with socket.create_connection((parts.hostname, parts.port), timeout=wait) as connection:
        connection.sendall(raw)
        answer = http.client.HTTPResponse(connection)
        answer.begin()
        body = answer.read()
    if "json" in answer.headers["Content-Type"]:
        return answer.status, json.loads(body).get("error", "")
    return answer.status, body.decode()


def request(
    server, method, path, body, *, digest=None, token=TOKEN, length=None, more=(), nonce=None, challenge=None,
):  # fmt: skip
    """Bytes of a request that is right but for what is given."""
    digest, nonce = digest_of(body) if digest is None else digest, nonce or secrets.token_hex(16)
    challenge = challenge or challenge_of(server)
    heads = {"Host": "x", DIGEST: digest, CHALLENGE: challenge, NONCE: nonce,
             SIGNATURE: signature(token, method, path, digest, challenge, nonce),
             "Content-Length": str(len(body) if length is None else length)} | dict(more)  # fmt: skip
    lines = [f"{method} {path} HTTP/1.1", *(f"{name}: {value}" for name, value in heads.items() if value is not None)]
    return "\r\n".join([*lines, "", ""]).encode("latin-1") + body


def challenge_of(server):
    if server.process.pid not in CHALLENGES:
        CHALLENGES[server.process.pid] = server.client.get("/healthz")["challenge"]
    return CHALLENGES[server.process.pid]


CHALLENGES = {}


def test_health_needs_no_token(server):
    status, _ = sent(server, b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")
    assert status == 200


ROWS, TRAIN = "/v1/sessions/car/rows", "/v1/sessions/car/train"
BROKEN = Policy((np.zeros((5, 2), np.float32),), (np.zeros(2, np.float32),)).text().encode()
HEADER = b"time,v_x,yaw_rate,steer,drive_force\n"


def hello(session="car", vehicle=SCENE.text, policy="0" * 64):
    return json.dumps({"session": session, "vehicle": vehicle, "policy": policy}).encode()


def parquet_bomb():
    """Four million zeros of each signal in a few kilobytes."""
    column = pa.array(np.zeros(4_000_000))
    table = pa.table(dict.fromkeys(("time", "v_x", "yaw_rate", "steer", "drive_force"), column))
    file = io.BytesIO()
    pq.write_table(table, file, compression="zstd")
    return file.getvalue()


SIGNED = {
    "wrong token": ("POST", ROWS, b"rows", {"token": b"another token, as long"}, 401, "signature"),
    "no signature": ("POST", ROWS, b"rows", {"more": {SIGNATURE: None}}, 401, "signature"),
    "strange signature": ("POST", ROWS, b"rows", {"more": {SIGNATURE: "\xff\xfe"}}, 401, "signature"),
    "wrong challenge": ("POST", ROWS, b"rows", {"challenge": "0" * 32}, 401, "healthz"),
    "short nonce": ("POST", ROWS, b"rows", {"nonce": "1"}, 401, "16 to 64"),
    "wrong hash": ("POST", ROWS, b"rows", {"digest": "0" * 64}, 422, "SHA-256"),
    "too large": ("POST", ROWS, b"", {"length": LARGEST + 1}, 413, "32 MB"),
    "too large a text": ("POST", TRAIN, b"", {"length": LARGEST_TEXT + 1}, 413, "1 MB"),
    "no length": ("POST", ROWS, b"", {"digest": digest_of(b"rows"), "more": {"Content-Length": None}}, 422, "SHA-256"),
    "negative length": ("POST", ROWS, b"", {"length": -5}, 400, "Invalid"),
    "no path": ("POST", "/v2/rows", b"rows", {}, 404, "/v1/"),
    "path of a file": ("GET", "/v1/policies/..%2F..%2Fstore", b"", {}, 404, "/v1/"),
    "a folder": ("GET", "/v1/jobs/..", b"", {}, 404, "job"),
    "another method": ("GET", ROWS, b"", {}, 405, "POST"),
    "no session": ("POST", "/v1/sessions/nobody/rows", b"rows", {}, 404, "session"),
    "no rows": ("POST", ROWS, b"time,v_x\n0,1\n", {}, 422, "rows"),
    "empty rows": ("POST", ROWS, b"", {}, 422, "rows"),
    "rows of another kind": ("POST", ROWS, b"\x00" * 500, {}, 422, "rows"),
    "rows without numbers": ("POST", ROWS, HEADER + b"".join(b"%f,nan,nan,nan,nan\n" % (0.02 * k) for k in range(50)),
                             {}, 422, ""),
    "damaged gzip": ("POST", ROWS, gzip.compress(b"rows" * 1000)[:-20], {}, 422, "unzipped"),
    "unpacked too large": ("POST", ROWS, gzip.compress(HEADER + b"0,1,0,0,0\n" * 3_500_000, 1), {}, 413, "32 MB"),
    "too many numbers": ("POST", ROWS, parquet_bomb(), {}, 413, "4 million"),
    "damaged Parquet": ("POST", ROWS, b"PAR1" + b"x" * 50 + b"PAR1", {}, 422, "Parquet"),
    "a policy of another shape": ("POST", "/v1/policies", BROKEN, {}, 422, "27"),
    "no policy": ("POST", "/v1/policies", b"{}", {}, 422, "policy"),
    "a policy of brackets": ("POST", "/v1/policies", b"[" * 900 + b"]" * 900, {}, 422, ""),
    "a hello without a vehicle": ("POST", "/v1/hello", b'{"session": "a", "policy": "b"}', {}, 422, "vehicle"),
    "a hello that is no JSON": ("POST", "/v1/hello", b"hello", {}, 422, "JSON"),
    "a session of dots": ("POST", "/v1/hello", hello("../.."), {}, 422, "letters"),
    "an unknown policy": ("POST", "/v1/hello", hello("other"), {}, 404, "policy"),
    "half a letter": ("POST", "/v1/hello", hello("other", "\ud800"), {}, 422, "vehicle"),
    "a job of no arm": ("POST", TRAIN, b'{"arm": "best"}', {}, 422, "arm"),
    "a job of a list": ("POST", TRAIN, b'{"arm": ["x"]}', {}, 422, "arm"),
    "a job of brackets": ("POST", TRAIN, b'{"arm": ' + b"[" * 900 + b"]" * 900 + b"}", {}, 422, "brackets"),
    "a job of more brackets": ("POST", TRAIN, b'{"arm": ' + b"[" * 90_000, {}, 422, "JSON"),
    "a job of no seconds": ("POST", TRAIN, b'{"seconds": -1}', {}, 422, "seconds"),
    "a job of no number": ("POST", TRAIN, b'{"steps": NaN}', {}, 422, "steps"),
    "a job without rows": ("POST", TRAIN, b"{}", {}, 422, "no rows"),
    "events of brackets": ("POST", "/v1/sessions/car/events", b'{"events": ' + b"[" * 900 + b"]" * 900 + b"}", {}, 422,
                           "brackets"),
}  # fmt: skip
RAW = {
    "no HTTP": (b"hello\r\n\r\n", 400, "HTTP"),
    "a long head": (b"GET /healthz HTTP/1.1\r\nX: " + b"x" * 20_000 + b"\r\n\r\n", 400, "HTTP"),
    "the page by another name": (b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n", 403, "machine"),
}


@pytest.mark.parametrize("what", SIGNED | RAW)
def test_what_is_wrong_is_a_status_and_a_sentence_and_changes_nothing(what, server):
    if what in RAW:
        raw, status, word = RAW[what]
    else:
        method, path, body, options, status, word = SIGNED[what]
        raw = request(server, method, path, body, **options)
    before = state(server)
    answer, sentence = sent(server, raw)
    assert (answer, word in sentence) == (status, True), (answer, sentence)
    assert state(server) == before


def test_another_vehicle_is_refused_under_a_session(server, policy):
    other = SCENE.text.replace("[parameters]", "[parameters]\n# the same car", 1)
    status, sentence = sent(server, request(server, "POST", "/v1/hello", hello("car", other, digest_of(policy))))
    assert (status, "another vehicle" in sentence) == (409, True)


def test_a_request_that_was_overheard_is_done_once(server, policy):
    raw = request(server, "POST", "/v1/hello", hello(policy=digest_of(policy)))
    before = state(server)
    assert sent(server, raw)[0] == 200
    status, sentence = sent(server, raw)
    assert (status, "before" in sentence) == (401, True)
    assert state(server) == before


def test_a_request_of_before_a_restart_is_not_done_after_it(known, policy):
    with serving(known) as first:
        raw = request(first, "POST", "/v1/hello", hello(policy=digest_of(policy)))
        first.kill()
    with serving(known) as second:
        status, sentence = sent(second, raw)
        assert (status, "healthz" in sentence) == (401, True)


def test_packed_rows_are_kept_unpacked(server, rows):
    answer = server.client.post(ROWS, gzip.compress(rows))
    assert (answer["new"], answer["rows"]) == (True, 400)
    (server.folder / "sessions" / "car" / "rows" / f"{answer['sha256']}.csv").unlink()


def test_strangers_starve_nobody(server):
    """More half heads and streams than there is room for, none of which takes what is streamed."""
    parts = urlsplit(server.address)
    stranger = (parts.hostname, parts.port)
    with contextlib.ExitStack() as strangers:
        for head in [b"GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"] * 64 + [b"POST /v1/hello HTTP/1.1\r\n"] * 150:
            strangers.enter_context(socket.create_connection(stranger, timeout=10)).sendall(head)
        assert server.client.get("/healthz")["status"] == "ok"
        connection = http.client.HTTPConnection(*stranger, timeout=10)
        connection.request("GET", "/events", headers={"Host": "127.0.0.1"})
        assert connection.getresponse().status == 200
        connection.close()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of another process are Linux's")
def test_a_full_disk_is_a_status_and_a_sentence(known, rows):
    """No file may be longer than a kilobyte."""
    import resource

    with serving(known) as own:
        before = state(own)
        resource.prlimit(own.process.pid, resource.RLIMIT_FSIZE, (1000, 1000))
        with pytest.raises(Declined, match="full") as refusal:
            own.client.post(ROWS, rows[:-20])
        assert refusal.value.status == 507
        assert own.client.get("/healthz")["status"] == "ok"
        assert state(own) == before


@pytest.mark.parametrize("text", [b"{", b"[]", b'{"id": 3}', b"\xff", b"[" * 3000])
def test_a_damaged_file_is_one_jobs_failure(text, server):
    folder = server.folder / "jobs" / "0123456789abcdef"
    folder.mkdir(parents=True)
    (folder / "job.json").write_bytes(text)
    job = server.client.get("/v1/jobs/0123456789abcdef")
    assert (job["status"], "damaged" in job["sentence"]) == ("failed", True)
    assert "no rows" in sent(server, request(server, "POST", TRAIN, b"{}"))[1]
    shutil.rmtree(folder)


def test_a_server_starts_over_a_damaged_job(tmp_path):
    folder = tmp_path / "state" / "jobs" / "0123456789abcdef"
    folder.mkdir(parents=True)
    (folder / "job.json").write_bytes(b"{")
    (tmp_path / "state" / "store.json").write_text('{"format": "greybox-loop-store", "format_version": 1}')
    with serving(tmp_path) as own:
        assert own.client.get("/healthz")["status"] == "ok"


@pytest.mark.parametrize("host", ["", " ", "0", "*", "0x0", "127.1", "nobody.invalid"])
def test_a_host_is_named(host, tmp_path):
    with pytest.raises(BadInput, match=r"host|listened"), listening(host, 0):
        pass


def test_the_missing_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    monkeypatch.delitem(sys.modules, listening.__module__)
    (tmp_path / "token").write_bytes(TOKEN)
    assert "greybox-id[serve]" in refused("serve", "--token-file", tmp_path / "token", "--out", tmp_path / "state")


def test_a_vehicle_file_names_no_other_file(server, policy):
    text = 'tyre_file = "/etc/passwd"\n' + SCENE.text
    with pytest.raises(Declined, match="tyre_file"):
        server.client.post("/v1/hello", {"session": "spy", "vehicle": text, "policy": digest_of(policy)})


def test_rows_and_policies_are_kept_once(server, policy, rows):
    assert begun(server.client, policy) == digest_of(policy)
    first, again = (server.client.post(ROWS, rows) for _ in range(2))
    assert (first["new"], first["rows"], again["new"]) == (True, 400, False)
    assert first["files"] == again["files"] == 1
    assert server.client.policy(digest_of(policy)) == policy
    (server.folder / "sessions" / "car" / "rows" / f"{first['sha256']}.csv").unlink()


@pytest.mark.slow
def test_a_slow_client_is_told_so_and_others_are_served_meanwhile(server):
    """Slowness is that of a head here, whose patience is 10 s."""
    parts = urlsplit(server.address)
    with socket.create_connection((parts.hostname, parts.port), timeout=20) as own:
        own.sendall(b"POST /v1/hello HTTP/1.1\r\n")
        for _ in range(3):
            assert sent(server, b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")[0] == 200
        begun_at = time.monotonic()
        answer = own.recv(1000)
    assert b" 400 " in answer
    assert time.monotonic() - begun_at < 15.0


@pytest.mark.parametrize("seed", [7])
def test_damaged_bodies_change_nothing(seed, server, rows, policy):
    """A body that is damaged on its way does not fit its hash; one that was damaged before is refused, or is sound."""
    before, generator = state(server), random.Random(seed)
    for case in range(100):
        body, path = generator.choice(((rows, ROWS), (policy[:20_000], "/v1/policies")))
        damaged = mutated(body, "csv" if path == ROWS else "columns", seed, case)
        if damaged == body:
            continue
        status, sentence = sent(server, request(server, "POST", path, damaged, digest=digest_of(body)))
        assert (status, bool(sentence)) == (422, True)
    assert state(server) == before


@pytest.mark.examination
@pytest.mark.slow
def test_a_thousand_damaged_bodies_with_right_hashes_are_answered(server, rows, policy):
    for case in range(1000):
        body, path, kind = ((rows, ROWS, "csv"), (policy, "/v1/policies", "columns"))[case % 2]
        status, sentence = sent(server, request(server, "POST", path, mutated(body, kind, 5, case)))
        assert status in (200, 413, 422, 507), (case, status, sentence)
        assert (status == 200) == (not sentence)
    assert sent(server, b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")[0] == 200


@pytest.mark.slow
def test_an_upload_that_a_kill_cuts_off_leaves_nothing(known, rows):
    rows = rows[: rows.rindex(b"\n", 0, -1) + 1]
    with serving(known) as own:
        before = state(own)
        parts = urlsplit(own.address)
        with socket.create_connection((parts.hostname, parts.port)) as half:
            half.sendall(request(own, "POST", ROWS, rows)[: len(rows) // 2])
            time.sleep(0.2)
            own.kill()
        assert state(own) == before
    with serving(known) as own:
        assert own.client.post(ROWS, rows)["new"]


@pytest.mark.slow
def test_a_job_that_a_kill_interrupts_is_done_after_the_restart(known, policy):
    """The budget ends the second one: what is learned does not matter here."""
    wanted = {"arm": "nominal", "seconds": 60, "steps": 10_000_000}
    with serving(known) as own:
        job = own.client.post("/v1/sessions/car/train", wanted)
        assert own.client.post("/v1/sessions/car/train", wanted)["id"] == job["id"]
        with pytest.raises(Declined, match="unfinished job"):
            own.client.post("/v1/sessions/car/train", {**wanted, "steps": 5})
        waited(own.client, job["id"], lambda now: now["status"] == TRAINING)
        own.kill()
    file = known / "state" / "jobs" / job["id"] / "job.json"
    held = json.loads(file.read_text())
    assert held["status"] in (QUEUED, TRAINING)
    file.write_text(json.dumps({**held, "steps": 1}))
    with serving(known) as own:
        found = waited(own.client, job["id"], lambda now: now["status"] not in (QUEUED, TRAINING))
        assert found["status"] == "done", found
        new = found["result"]["policy"]
        assert new != digest_of(policy)
        assert digest_of(own.client.policy(new)) == new
        assert own.terminate() == 0


def waited(client, own, until, seconds=180.0):
    """A job, as soon as something is true of it."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        now = client.get(f"/v1/jobs/{own}")
        if until(now):
            return now
        time.sleep(0.2)
    raise AssertionError(now)


def test_it_ends_within_two_seconds_with_a_job_under_way(known):
    with serving(known) as own:
        job = own.client.post("/v1/sessions/car/train", {"arm": "named", "seconds": 100})
        waited(own.client, job["id"], lambda now: now["status"] == TRAINING)
        before, begun_at = state(own), time.monotonic()
        assert own.terminate() == 0
        assert time.monotonic() - begun_at < 2.0
        assert state(own) == before


def test_many_at_once_are_all_served(server, rows):
    with ThreadPoolExecutor(16) as many:
        found = list(many.map(lambda k: sent(server, request(server, "GET", "/v1/jobs/0", b""))[0], range(64)))
    assert set(found) == {404}


def test_events_are_shown(server):
    server.client.post("/v1/sessions/car/events", {"events": [{"kind": "telemetry", "v_x": 2.5}]})
    parts = urlsplit(server.address)
    connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=10)
    connection.request("GET", "/events")
    answer = connection.getresponse()
    assert answer.getheader("Content-Type") == "text/event-stream"
    while b'"v_x": 2.5' not in answer.readline():
        pass  # what does not come is a time-out
    connection.close()
    connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=10)
    connection.request("GET", "/")
    assert b"EventSource" in connection.getresponse().read()
    connection.close()


def test_a_token_is_long_enough(tmp_path):
    file = tmp_path / "token"
    file.write_text("short\n")
    with pytest.raises(BadInput, match="16 characters"):
        read_token(file)
    with pytest.raises(BadInput, match="cannot be read"):
        read_token(tmp_path / "nothing")


@pytest.mark.parametrize("address", ["127.0.0.1:80", "https://x", "http://x:port", "http://", "http://x/v1"])
def test_what_is_no_address_is_a_sentence(address):
    with pytest.raises(BadInput, match="no address"):
        Client(address, TOKEN)


def test_nobody_there_is_a_sentence():
    with socket.socket() as own:
        own.bind(("127.0.0.1", 0))
        port = own.getsockname()[1]
    with pytest.raises(BadInput, match="does not answer"):
        Client(f"http://127.0.0.1:{port}", TOKEN).get("/v1/jobs/0")


def test_one_server_has_a_folder_for_itself(server):
    folder = server.folder
    said = refused("serve", "--token-file", folder.parent / "token.txt", "--port", 0, "--out", folder)
    assert f"Another run writes to {folder}" in said
    assert server.client.get("/healthz")["status"] == "ok"
