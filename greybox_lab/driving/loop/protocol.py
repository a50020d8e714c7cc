"""What vehicle and server agree on: the token, what is signed, how large a body may be, and what can be asked for."""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Mapping
from pathlib import Path

from greybox_id.base.errors import BadInput
from greybox_id.base.files import small_file

PROTOCOL = 1
LARGEST = 32 << 20
"""Bytes of a body at most."""
SHORTEST = 16
"""Characters of a token at least: those of 64 random bits in hexadecimal."""
MADE = 'python -c "import secrets; print(secrets.token_hex(32))" > token.txt'
"""How a token is made."""
SIGNATURE, DIGEST = "X-Greybox-Signature", "X-Greybox-Sha256"
"""Headers of every request but `GET /healthz`."""

ARMS: Mapping[str, str] = {
    "named": "closed by what `greybox gap` names, drawn within its intervals",
    "named_residual": "the same, and five networks of what it is off by where something is likelier unnamed than not",
    "refit": "the parameters of the vehicle file, fitted",
    "actuator_net": "a network of three steps says the yaw rate, as published",
    "abstract": "a network of fifteen steps says yaw rate and v_y",
    "residual": "five networks say what the vehicle file's model is off by, the less the further they part",
    "hand": "the vehicle file; friction, mass and delay drawn from published ranges",
    "nominal": "the vehicle file alone",
}
"""What is made of rows, for a driver to learn on."""


class Declined(BadInput):
    """A request that is not done.

    Attributes
    ----------
    status : of HTTP.
    """

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


def digest_of(body: bytes) -> str:
    """SHA-256, 64 hexadecimal digits."""
    return hashlib.sha256(body).hexdigest()


def signature(token: bytes, method: str, path: str, digest: str) -> str:
    """HMAC-SHA-256 of the lines method, path and the body's SHA-256, with the token as key.

    The body is signed through its hash, so that a stranger is turned away before anything of a body is read.
    """
    return hmac.new(token, f"{method}\n{path}\n{digest}".encode(), hashlib.sha256).hexdigest()


def is_signed(token: bytes, method: str, path: str, digest: str, signed: str) -> bool:
    """Whether a signature is right; this takes as long whether it is or not."""
    return hmac.compare_digest(signature(token, method, path, digest).encode(), signed.encode("utf-8", "replace"))


def read_token(path: str | Path) -> bytes:
    """The token of a file, without blanks around it.

    Raises
    ------
    BadInput : it cannot be read, or holds too little to be a secret.
    """
    token = small_file(path, "token file").strip()
    if len(token) < SHORTEST:
        raise BadInput(f"{path}: a token of {SHORTEST} characters or more is needed; make one with: {MADE}.")
    return token
