"""A server answers what is wrong by a status and a sentence, changes nothing then, and loses nothing by a kill."""

import http.client
import json
import random
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import urlsplit

import numpy as np
import pytest
from calling import refused
from hand import by_hand
from hostile_mutations import mutated
from serving import TOKEN, serving

from greybox_id.base.errors import BadInput
from greybox_id.models.registry import motion_model_of
from greybox_lab.driving.loop.adapting import world_of
from greybox_lab.driving.loop.client import Client
from greybox_lab.driving.loop.protocol import DIGEST, LARGEST, SIGNATURE, Declined, digest_of, read_token, signature
from greybox_lab.driving.loop.scene import Hands, Scene, driven
from greybox_lab.driving.loop.store import QUEUED, TRAINING
from greybox_lab.driving.racing.learner import shipped_learned
from greybox_lab.driving.racing.policy import Policy
from greybox_lab.exam.make import write_recording

SCENE = Scene(1)


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """Bytes of a drive."""
    file = tmp_path_factory.mktemp("rows") / "rows.csv"
    world = world_of(motion_model_of(SCENE.vehicle), SCENE.vehicle, 1, 0.6)
    write_recording(driven(SCENE, Hands(world, by_hand().act), 400, 0).recordings[0], file)
    return file.read_bytes()


@pytest.fixture(scope="module")
def policy():
    return shipped_learned().text().encode()


@pytest.fixture(scope="module")
def server(tmp_path_factory, policy):
    """A server that knows a policy and the session `car`."""
    with serving(tmp_path_factory.mktemp("server")) as own:
        begun(own.client, policy)
        yield own


def begun(client, policy):
    sha = client.post("/v1/policies", policy)["sha256"]
    client.post("/v1/hello", {"session": "car", "vehicle": SCENE.text, "policy": sha})
    return sha


def state(server):
    """Everything on disk but what is under way."""
    return {
        str(own.relative_to(server.folder)): own.read_bytes()
        for own in server.folder.rglob("*")
        if own.is_file() and not own.name.startswith(".greybox-")
    }


def sent(server, raw, wait=15.0):
    """Status and sentence of bytes as they are, after which nothing more is sent."""
    parts = urlsplit(server.address)
    with socket.create_connection((parts.hostname, parts.port), timeout=wait) as own:
        own.sendall(raw)
        own.shutdown(socket.SHUT_WR)
        answer = http.client.HTTPResponse(own)
        answer.begin()
        body = json.loads(answer.read())
    return answer.status, body.get("error", "")


def request(method, path, body, *, digest=None, token=TOKEN, length=None, more=()):
    """Bytes of a request, right unless told otherwise."""
    digest = digest_of(body) if digest is None else digest
    heads = {"Host": "x", DIGEST: digest, SIGNATURE: signature(token, method, path, digest),
             "Content-Length": str(len(body) if length is None else length)} | dict(more)  # fmt: skip
    lines = [f"{method} {path} HTTP/1.1", *(f"{name}: {value}" for name, value in heads.items() if value is not None)]
    return "\r\n".join([*lines, "", ""]).encode() + body


def test_health_needs_no_token(server):
    status, _ = sent(server, b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")
    assert status == 200


ROWS = "/v1/sessions/car/rows"


def wrong_requests(rows):
    """What is wrong -> a request, the status, and a word of the sentence."""
    broken = Policy((np.zeros((5, 2), np.float32),), (np.zeros(2, np.float32),)).text().encode()
    other = SCENE.text.replace("[parameters]", "[parameters]\n# the same car", 1)
    return {
        "wrong token": (request("POST", ROWS, rows, token=b"another token, as long"), 401, "signature"),
        "no signature": (request("POST", ROWS, rows, more={SIGNATURE: None}), 401, "signature"),
        "signature of another path": (request("POST", "/v1/policies", rows).replace(b"/v1/policies", ROWS.encode()),
                                      401, "signature"),
        "strange signature": (request("POST", ROWS, rows, more={SIGNATURE: "\xff\xfe"}), 401, "signature"),
        "wrong hash": (request("POST", ROWS, rows, digest="0" * 64), 422, "SHA-256"),
        "too large": (request("POST", ROWS, b"", length=LARGEST + 1), 413, "32 MB"),
        "no length": (request("POST", ROWS, rows, more={"Content-Length": None}), 411, "Content-Length"),
        "negative length": (request("POST", ROWS, b"", length=-5), 411, "Content-Length"),
        "in pieces": (request("POST", ROWS, rows, more={"Transfer-Encoding": "chunked"}), 411, "one piece"),
        "cut short": (request("POST", ROWS, rows[:1000], digest=digest_of(rows), length=len(rows)), 400, "cut short"),
        "no path": (request("POST", "/v2/rows", rows), 404, "/v1/"),
        "path of a file": (request("GET", "/v1/policies/..%2F..%2Fstore", b""), 404, "policy"),
        "a folder": (request("GET", "/v1/jobs/..", b""), 404, "job"),
        "another method": (request("GET", ROWS, b""), 405, "POST"),
        "no session": (request("POST", "/v1/sessions/nobody/rows", rows), 404, "session"),
        "no rows": (request("POST", ROWS, b"time,v_x\n0,1\n"), 422, "rows"),
        "empty rows": (request("POST", ROWS, b""), 422, "rows"),
        "rows of another kind": (request("POST", ROWS, b"\x00" * 500), 422, "rows"),
        "rows without numbers": (request("POST", ROWS, b"time,v_x,yaw_rate,steer,drive_force\n" + b"".join(
            b"%f,nan,nan,nan,nan\n" % (0.02 * k) for k in range(50))), 422, ""),
        "a policy of another shape": (request("POST", "/v1/policies", broken), 422, "27"),
        "no policy": (request("POST", "/v1/policies", b"{}"), 422, "policy"),
        "a hello without a vehicle": (request("POST", "/v1/hello", b'{"session": "a", "policy": "b"}'), 422, "vehicle"),
        "a hello that is no JSON": (request("POST", "/v1/hello", b"hello"), 422, "JSON"),
        "a session of dots": (request("POST", "/v1/hello", json.dumps(
            {"session": "../..", "vehicle": SCENE.text, "policy": "0" * 64}).encode()), 422, "letters"),
        "an unknown policy": (request("POST", "/v1/hello", json.dumps(
            {"session": "other", "vehicle": SCENE.text, "policy": "0" * 64}).encode()), 404, "policy"),
        "another vehicle": (request("POST", "/v1/hello", json.dumps({"session": "car", "vehicle": other, "policy":
            digest_of(shipped_learned().text().encode())}).encode()), 409, "another vehicle"),
        "a job of no arm": (request("POST", "/v1/sessions/car/train", b'{"arm": "best"}'), 422, "arm"),
        "a job of no seconds": (request("POST", "/v1/sessions/car/train", b'{"seconds": -1}'), 422, "seconds"),
        "a job of no number": (request("POST", "/v1/sessions/car/train", b'{"steps": NaN}'), 422, "steps"),
        "a job without rows": (request("POST", "/v1/sessions/car/train", b"{}"), 422, "no rows"),
        "no HTTP": (b"hello\r\n\r\n", 400, "HTTP"),
        "half a head": (b"POST /v1/hello HTTP/1.1\r\nHost", 400, "cut short"),
        "a header twice": (request("POST", ROWS, rows, more={DIGEST.lower(): "0"}), 400, "twice"),
        "a long head": (b"GET /healthz HTTP/1.1\r\nX: " + b"x" * 20_000 + b"\r\n\r\n", 431, "head"),
        "the page by another name": (b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n", 403, "machine"),
    }  # fmt: skip


@pytest.mark.parametrize("what", wrong_requests(b"rows"))
def test_what_is_wrong_is_a_status_and_a_sentence_and_changes_nothing(what, server, rows):
    raw, status, word = wrong_requests(rows)[what]
    before = state(server)
    found, sentence = sent(server, raw)
    assert (found, word in sentence) == (status, True), (found, sentence)
    assert state(server) == before


def test_a_vehicle_file_names_no_other_file(server, policy):
    text = 'tyre_file = "/etc/passwd"\n' + SCENE.text
    with pytest.raises(Declined, match="tyre_file"):
        server.client.post("/v1/hello", {"session": "spy", "vehicle": text, "policy": digest_of(policy)})


def test_rows_and_policies_are_kept_once(tmp_path, policy, rows):
    with serving(tmp_path) as own:
        sha = begun(own.client, policy)
        assert begun(own.client, policy) == sha
        first, again = (own.client.post(ROWS, rows) for _ in range(2))
        assert (first["new"], first["rows"], again["new"]) == (True, 400, False)
        assert first["files"] == again["files"] == 1
        assert own.client.policy(sha) == policy


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
    assert b" 408 " in answer
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
        status, sentence = sent(server, request("POST", path, damaged, digest=digest_of(body)))
        assert (status, bool(sentence)) == (422, True)
    assert state(server) == before


@pytest.mark.slow
def test_a_thousand_damaged_bodies_with_right_hashes_are_answered(server, rows, policy):
    for case in range(1000):
        body, path, kind = ((rows, ROWS, "csv"), (policy, "/v1/policies", "columns"))[case % 2]
        status, sentence = sent(server, request("POST", path, mutated(body, kind, 5, case)))
        assert status in (200, 413, 422, 507), (case, status, sentence)
        assert (status == 200) == (not sentence)
    assert sent(server, b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")[0] == 200


def test_an_upload_that_a_kill_cuts_off_leaves_nothing(tmp_path, policy, rows):
    with serving(tmp_path) as own:
        begun(own.client, policy)
        before = state(own)
        parts = urlsplit(own.address)
        with socket.create_connection((parts.hostname, parts.port)) as half:
            half.sendall(request("POST", ROWS, rows)[: len(rows) // 2])
            time.sleep(0.2)
            own.kill()
        assert state(own) == before
    with serving(tmp_path) as own:
        assert own.client.post(ROWS, rows)["new"]


@pytest.mark.slow
def test_a_job_that_a_kill_interrupts_is_done_after_the_restart(tmp_path, policy, rows):
    """The budget ends the second one: what is learned does not matter here."""
    wanted = {"arm": "nominal", "seconds": 60, "steps": 10_000_000}
    with serving(tmp_path) as own:
        sha = begun(own.client, policy)
        own.client.post(ROWS, rows)
        job = own.client.post("/v1/sessions/car/train", wanted)
        assert own.client.post("/v1/sessions/car/train", wanted)["id"] == job["id"]
        with pytest.raises(Declined, match="not over"):
            own.client.post("/v1/sessions/car/train", {**wanted, "steps": 5})
        waited(own.client, job["id"], lambda now: now["status"] == TRAINING)
        own.kill()
    file = tmp_path / "state" / "jobs" / job["id"] / "job.json"
    held = json.loads(file.read_text())
    assert held["status"] in (QUEUED, TRAINING)
    file.write_text(json.dumps({**held, "steps": 1}))
    with serving(tmp_path) as own:
        found = waited(own.client, job["id"], lambda now: now["status"] not in (QUEUED, TRAINING))
        assert found["status"] == "done", found
        new = found["result"]["policy"]
        assert new != sha
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


def test_it_ends_within_two_seconds_with_a_job_under_way(tmp_path, policy, rows):
    with serving(tmp_path) as own:
        begun(own.client, policy)
        own.client.post(ROWS, rows)
        job = own.client.post("/v1/sessions/car/train", {"arm": "named", "seconds": 100})
        waited(own.client, job["id"], lambda now: now["status"] == TRAINING)
        before, begun_at = state(own), time.monotonic()
        assert own.terminate() == 0
        assert time.monotonic() - begun_at < 2.0
        assert state(own) == before


def test_many_at_once_are_all_served(server, rows):
    with ThreadPoolExecutor(16) as many:
        found = list(many.map(lambda k: sent(server, request("GET", "/v1/jobs/0", b""))[0], range(64)))
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
