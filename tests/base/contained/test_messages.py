"""Messages go over a pipe unchanged; what is no message is never taken for one."""

import io
import json

import numpy as np
import pytest

from greybox_id.base.contained import inside

ARRAY = {"dtype": "<f8", "shape": [2]}


def framed(head, rest=b""):
    text = head if isinstance(head, bytes) else json.dumps(head).encode()
    return io.BytesIO(inside.LENGTH.pack(len(text)) + text + rest)


def test_messages_follow_each_other():
    pipe = io.BytesIO()
    inside.send(pipe, {"ask": "größe"}, np.arange(6.0).reshape(2, 3).T)
    inside.send(pipe, {"of": [None]})
    pipe.seek(0)
    message, array = inside.receive(pipe, 48)
    assert message == {"ask": "größe"}
    np.testing.assert_array_equal(array, np.arange(6.0).reshape(2, 3).T)
    assert inside.receive(pipe, 0) == ({"of": [None]}, None)
    with pytest.raises(EOFError):
        inside.receive(pipe, 0)


@pytest.mark.parametrize(
    "head",
    [b"", b"{", b"\xff", b"[" * 10**5, [], {}, {"message": {}}, {"message": 3, "array": None}]
    + [
        {"message": {}, "array": {**ARRAY, **strange}}
        for strange in (
            {"dtype": "O"}, {"dtype": "V8"}, {"dtype": "U0"}, {"dtype": "f8,O"}, {"dtype": 3}, {"shape": [-1]},
            {"shape": [10**9]}, {"shape": [-(2**40), -(2**40)]}, {"shape": "ab"}, {"shape": None}, {"shape": [3]},
        )
    ],
)  # fmt: skip
def test_nonsense_is_refused(head):
    with pytest.raises(Exception):  # noqa: B017, PT011 - which one depends on the nonsense
        inside.receive(framed(head, bytes(16)), 1000)


def test_a_message_of_a_length_no_message_has_is_refused_before_it_is_read():
    with pytest.raises(ValueError, match="a message of"):
        inside.receive(io.BytesIO(b"\xff" * 100), 1000)


@pytest.mark.parametrize(
    ("message", "array"), [({"of": object()}, None), ({}, np.array([{}])), ({"of": "a" * 2**25}, None)]
)
def test_what_cannot_be_sent_leaves_the_pipe_clean(message, array):
    pipe = io.BytesIO()
    with pytest.raises((TypeError, ValueError)):
        inside.send(pipe, message, array)
    assert pipe.getvalue() == b""
