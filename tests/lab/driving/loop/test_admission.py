"""Who has the token gets a turn, but nobody all of them; a request is admitted once."""

import asyncio
from types import SimpleNamespace

import pytest

from greybox_lab.driving.loop import admission
from greybox_lab.driving.loop.admission import EACH, LINE, TURNS, Admission, Turns
from greybox_lab.driving.loop.protocol import Declined, signed_headers

TOKEN = b"a token that is long enough"


def request(challenge, token=TOKEN):
    headers = signed_headers(token, "POST", "/v1/hello", b"", challenge)
    return SimpleNamespace(method="POST", scope={"raw_path": b"/v1/hello"}, headers=headers)


def test_a_request_is_admitted_once():
    admitted = Admission(TOKEN)
    one = request(admitted.challenge)
    admitted.check(one)
    admitted.check(request(admitted.challenge))
    with pytest.raises(Declined, match="before"):
        admitted.check(one)


def test_a_full_memory_begins_with_another_challenge(monkeypatch):
    monkeypatch.setattr(admission, "REMEMBERED", 3)
    admitted = Admission(TOKEN)
    first = admitted.challenge
    requests = [request(first) for _ in range(4)]
    for one in requests:
        admitted.check(one)
    assert admitted.challenge != first
    with pytest.raises(Declined, match="healthz") as declined:
        admitted.check(requests[0])
    assert declined.value.challenge == admitted.challenge


def held(turns, client, over, begun):
    async def hold():
        async with turns.turn(client):
            begun.append(client)
            await over.wait()

    return asyncio.create_task(hold())


def test_one_session_leaves_turns_to_others():
    async def main():
        turns, over, begun = Turns(10.0), asyncio.Event(), []
        tasks = [held(turns, client, over, begun) for client in ["loud"] * 20 + ["quiet"] * 2]
        await asyncio.sleep(0.05)
        assert begun.count("loud") == EACH < TURNS
        assert begun.count("quiet") == 2
        over.set()
        await asyncio.gather(*tasks)
        assert begun.count("loud") == 20

    asyncio.run(main())


def test_a_line_that_is_too_long_and_a_turn_that_does_not_come_are_sentences():
    async def main():
        turns, over, begun = Turns(0.2), asyncio.Event(), []
        tasks = [held(turns, "car", over, begun) for _ in range(EACH + LINE + 1)]
        await asyncio.sleep(0.05)
        over.clear()
        ended = await asyncio.gather(*tasks[EACH:], return_exceptions=True)
        assert {error.status for error in ended} == {503}
        over.set()
        await asyncio.gather(*tasks[:EACH])

    asyncio.run(main())
