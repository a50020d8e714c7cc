"""The page answers those who know its address, of this machine, and nobody else."""

import asyncio

import pytest

from greybox_lab.app.server import Guard

TOKEN, HOST = "a-token-of-the-test", "127.0.0.1:8123"


async def inner(scope, receive, send):
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"page"})


def answer(query="", kind="http", **headers):
    sent = []

    async def receive():
        return {"type": "http.request", "body": b""}

    async def send(message):
        sent.append(message)

    given = {"host": HOST} | {name.replace("_", "-"): value for name, value in headers.items()}
    scope = {
        "type": kind, "query_string": query.encode(), "headers": [(k.encode(), v.encode()) for k, v in given.items()],
    }  # fmt: skip
    asyncio.run(Guard(inner, TOKEN, 8123)(scope, receive, send))
    return sent


def test_the_token_opens_the_page_and_is_remembered():
    first = answer(f"token={TOKEN}")
    assert first[0]["status"] == 200
    cookie = dict(first[0]["headers"])[b"set-cookie"].decode()
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    again = answer(cookie=cookie.split(";")[0])
    assert again[0]["status"] == 200


@pytest.mark.parametrize(
    ("query", "headers"),
    [
        ("", {}),
        ("token=another", {}),
        ("", {"cookie": "greybox_app_8123=another"}),
        (f"token={TOKEN}", {"host": "evil.example:8123"}),
        (f"token={TOKEN}", {"origin": "http://evil.example"}),
    ],
)
def test_others_are_refused(query, headers):
    assert answer(query, **headers)[0]["status"] == 403
    assert answer(query, kind="websocket", **headers) == [{"type": "websocket.close", "code": 1008}]


def test_a_body_larger_than_any_recording_is_refused():
    assert answer(f"token={TOKEN}", content_length=str(2 * 2**30))[0]["status"] == 413
    assert b"500 MB" in answer(f"token={TOKEN}", content_length=str(2 * 2**30))[1]["body"]
    assert answer(f"token={TOKEN}", transfer_encoding="chunked")[0]["status"] == 413  # as long as one likes
