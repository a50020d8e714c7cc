"""What vehicle and server agree on: the token, what is signed, how large a body may be, what can be learned."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Mapping
from pathlib import Path

from greybox_id.base.errors import BadInput
from greybox_id.base.files import small_file

PROTOCOL = 2
LARGEST, LARGEST_TEXT = 32 << 20, 1 << 20
"""Bytes at most of a body of rows, also once it is unpacked, and of any other body."""
GZIP, PARQUET = b"\x1f\x8b", b"PAR1"
"""How bodies begin that are packed or a table."""
SHORTEST = 16
"""Characters of a token at least: those of 64 random bits in hexadecimal."""
MADE = 'python -c "import secrets; print(secrets.token_hex(32))" > token.txt'
"""How a token is made."""
SIGNATURE, DIGEST = "X-Greybox-Signature", "X-Greybox-Sha256"
CHALLENGE, NONCE = "X-Greybox-Challenge", "X-Greybox-Nonce"
"""Headers of every request but `GET /healthz`."""

ARMS: Mapping[str, str] = {
    "named": "the vehicle file with the effects that `greybox gap` names, drawn within their intervals",
    "named_residual": "as named; if an unmodelled effect is likely, with five networks for the remaining error",
    "refit": "the parameters of the vehicle file, fitted",
    "actuator_net": "a network predicts the yaw rate from three steps, as published",
    "abstract": "a network predicts yaw rate and v_y from fifteen steps",
    "residual": "five networks correct the vehicle file's model; the correction shrinks where they disagree",
    "hand": "the vehicle file; friction, mass and delay drawn from published ranges",
    "nominal": "the vehicle file alone",
}
"""What is made of rows, for a driver to learn on."""


class Declined(BadInput):
    """A request that is not done.

    Attributes
    ----------
    status : of HTTP.
    challenge : to be signed from now on, where the server has another one than was signed.
    """

    def __init__(self, status: int, sentence: str, challenge: str = "") -> None:
        super().__init__(sentence)
        self.status, self.challenge = status, challenge


def digest_of(body: bytes) -> str:
    """SHA-256, 64 hexadecimal digits."""
    return hashlib.sha256(body).hexdigest()


def signature(token: bytes, method: str, path: str, digest: str, challenge: str, nonce: str) -> str:
    """HMAC-SHA-256 of the lines method, path, the body's SHA-256, challenge and nonce, with the token as key.

    The body is signed through its hash, so that a stranger is turned away before anything of a body is read. The
    challenge is the server's, from `GET /healthz`, and the nonce is new for each request: a request that somebody
    overheard is not done again.
    """
    lines = "\n".join((method, path, digest, challenge, nonce))
    return hmac.new(token, lines.encode("utf-8", "replace"), hashlib.sha256).hexdigest()


def signed_headers(token: bytes, method: str, path: str, body: bytes, challenge: str) -> dict[str, str]:
    """Headers of a request that is sent once."""
    digest, nonce = digest_of(body), secrets.token_hex(16)
    signed = signature(token, method, path, digest, challenge, nonce)
    return {DIGEST: digest, CHALLENGE: challenge, NONCE: nonce, SIGNATURE: signed}


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
