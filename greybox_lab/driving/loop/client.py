"""A vehicle's words to a server: signed requests, answered by plain data or a sentence."""

from __future__ import annotations

import http.client
import json
from collections.abc import Mapping
from typing import Any
from urllib.parse import urlsplit

from greybox_id.base.errors import BadInput

from .protocol import DIGEST, SIGNATURE, Declined, digest_of, signature

PATIENCE = 30.0
"""s to wait for an answer."""


class Unanswered(BadInput):
    """Nobody answers, or not in time; what was asked may be asked again."""


class Client:
    """A server as seen from a vehicle.

    Parameters
    ----------
    address : as the server prints it.
    token : see `protocol.read_token`.

    Raises
    ------
    BadInput : this is no address.
    """

    def __init__(self, address: str, token: bytes) -> None:
        try:
            parts = urlsplit(address)
            self._host, self._port = parts.hostname or "", parts.port or 80
        except ValueError as error:
            raise BadInput(f"{address} is no address; a server prints its own, as http://127.0.0.1:8787.") from error
        if parts.scheme != "http" or not self._host or parts.path not in ("", "/"):
            raise BadInput(f"{address} is no address; a server prints its own, as http://127.0.0.1:8787.")
        self._address, self._token = address, token

    def post(self, path: str, body: Mapping[str, Any] | bytes) -> dict[str, Any]:
        """The answer to what is sent. Raises `Declined`, `Unanswered`."""
        held = body if isinstance(body, bytes) else json.dumps(body).encode()
        return _object(self._asked("POST", path, held))

    def get(self, path: str) -> dict[str, Any]:
        """What is there. Raises `Declined`, `Unanswered`."""
        return _object(self._asked("GET", path, b""))

    def policy(self, sha: str) -> bytes:
        """The bytes of a policy, whose SHA-256 is right. Raises `Declined`, `Unanswered`."""
        found = self._asked("GET", f"/v1/policies/{sha}", b"")
        if digest_of(found) != sha:
            raise Unanswered("The policy did not arrive as it was sent; ask again.")
        return found

    def _asked(self, method: str, path: str, body: bytes) -> bytes:
        digest = digest_of(body)
        heads = {DIGEST: digest, SIGNATURE: signature(self._token, method, path, digest)}
        connection = http.client.HTTPConnection(self._host, self._port, timeout=PATIENCE)
        try:
            connection.request(method, path, body, heads)
            answer = connection.getresponse()
            found = answer.read()
        except (OSError, http.client.HTTPException) as error:
            raise Unanswered(f"{self._address} does not answer ({error}); is `greybox serve` running?") from error
        finally:
            connection.close()
        if answer.status != http.HTTPStatus.OK:
            raise Declined(answer.status, f"{self._address}: {_object(found).get('error', answer.reason)}")
        return found


def _object(body: bytes) -> dict[str, Any]:
    try:
        found = json.loads(body)
    except ValueError as error:
        raise Unanswered("The answer is no JSON: this is no server of greybox-id.") from error
    if not isinstance(found, dict):
        raise Unanswered("The answer is no JSON object: this is no server of greybox-id.")
    return found
