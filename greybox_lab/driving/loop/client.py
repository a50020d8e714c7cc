"""A vehicle's words to a server: signed requests, answered by plain data or a sentence."""

from __future__ import annotations

import http.client
import json
from collections.abc import Mapping
from typing import Any
from urllib.parse import urlsplit

from greybox_id.base.errors import BadInput

from .protocol import Declined, digest_of, signed_headers

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
        self._address, self._token, self._challenge = address, token, ""

    def post(self, path: str, body: Mapping[str, Any] | bytes) -> dict[str, Any]:
        """The answer to what is sent. Raises `Declined`, `Unanswered`."""
        return _object(self._request("POST", path, body if isinstance(body, bytes) else json.dumps(body).encode()))

    def get(self, path: str) -> dict[str, Any]:
        """What is there. Raises `Declined`, `Unanswered`."""
        return _object(self._request("GET", path, b""))

    def policy(self, sha: str) -> bytes:
        """The bytes of a policy, whose SHA-256 is right. Raises `Declined`, `Unanswered`."""
        body = self._request("GET", f"/v1/policies/{sha}", b"")
        if digest_of(body) != sha:
            raise Unanswered("The policy did not arrive as it was sent; ask again.")
        return body

    def _request(self, method: str, path: str, body: bytes) -> bytes:
        """An answer; signed anew where the server has begun with another challenge."""
        if not self._challenge:
            health = _object(self._once("GET", "/healthz", b"", {}))
            self._challenge = str(health.get("challenge", ""))
        try:
            return self._once(method, path, body, signed_headers(self._token, method, path, body, self._challenge))
        except Declined as declined:
            if declined.challenge in ("", self._challenge):
                raise
            self._challenge = declined.challenge
        return self._once(method, path, body, signed_headers(self._token, method, path, body, self._challenge))

    def _once(self, method: str, path: str, body: bytes, headers: Mapping[str, str]) -> bytes:
        connection = http.client.HTTPConnection(self._host, self._port, timeout=PATIENCE)
        try:
            connection.request(method, path, body, dict(headers))
            response = connection.getresponse()
            content = response.read()
        except (OSError, http.client.HTTPException) as error:
            raise Unanswered(f"{self._address} does not answer ({error}); is `greybox serve` running?") from error
        finally:
            connection.close()
        if response.status != http.HTTPStatus.OK:
            answer = _object(content)
            sentence = f"{self._address}: {answer.get('error', response.reason)}"
            raise Declined(response.status, sentence, str(answer.get("challenge", "")))
        return content


def _object(body: bytes) -> dict[str, Any]:
    try:
        answer = json.loads(body)
    except ValueError as error:
        raise Unanswered("The answer is not JSON: this is not a server of greybox-id.") from error
    if not isinstance(answer, dict):
        raise Unanswered("The answer is not a JSON object: this is not a server of greybox-id.")
    return answer
