"""Who may ask a server, and how much at a time: strangers, replays, and turns of those who have the token."""

from __future__ import annotations

import asyncio
import re
import secrets
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Any

import h11
from starlette.requests import Request
from starlette.types import Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from .protocol import CHALLENGE, DIGEST, NONCE, SIGNATURE, Declined, signature

STRANGERS = 128
"""Connections at a time that have shown no signature: an eighth of the files that a process may usually open."""
REMEMBERED = 100_000
"""Nonces that are remembered, about 20 MB; after as many requests the challenge is another one."""
TURNS, EACH, LINE = 8, 4, 64
"""Bodies at a time of all who have the token, half of them of one session; and those that wait for their turn."""
NONCES = re.compile(r"[0-9A-Za-z_-]{16,64}")


class Strangers:
    """Connections that have shown no signature, the oldest first; a further one than `STRANGERS` ends the oldest.

    Parameters
    ----------
    patience : s in which a connection has to send the head of a request.
    """

    def __init__(self, patience: float) -> None:
        self.patience = patience
        self._connections: dict[Connection, None] = {}

    def add(self, connection: Connection) -> None:
        """A connection of which nothing is known."""
        if len(self._connections) >= STRANGERS:
            oldest = next(iter(self._connections))
            self.remove(oldest)
            oldest.transport.abort()
        self._connections[connection] = None

    def remove(self, connection: Connection) -> None:
        """A connection that is trusted, or gone."""
        self._connections.pop(connection, None)


class Connection(H11Protocol):
    """A connection of uvicorn's that does not wait for ever for a request's head."""

    def __init__(self, strangers: Strangers, **given: Any) -> None:
        super().__init__(**given)
        self._strangers, self._served = strangers, self.app
        self.app = self._introduced
        self._late: asyncio.TimerHandle | None = None

    async def _introduced(self, scope: Scope, receive: Receive, send: Send) -> None:
        scope["connection"] = self
        await self._served(scope, receive, send)

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait."""
        super().connection_made(transport)
        self._strangers.add(self)
        self._late = self.loop.call_later(self._strangers.patience, self._give_up)

    def handle_events(self) -> None:
        """Stop waiting when a request's head is there."""
        super().handle_events()
        if self._late is not None and self.cycle is not None:
            self._late.cancel()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        super().connection_lost(exc)
        self._strangers.remove(self)
        if self._late is not None:
            self._late.cancel()

    def trust(self) -> None:
        """Keep the connection, whoever else comes."""
        self._strangers.remove(self)

    def _give_up(self) -> None:
        if not self.transport.is_closing():
            with suppress(h11.LocalProtocolError):
                self.send_400_response("The header of the request did not arrive in time.")
            self.transport.close()


class Admission:
    """Whether a request is signed by who has the token, for the first time.

    Parameters
    ----------
    token : that signs.

    Attributes
    ----------
    challenge : that is to be signed, another one for each server and each `REMEMBERED` requests.
    """

    def __init__(self, token: bytes) -> None:
        self._token = token
        self._begin()

    def _begin(self) -> None:
        self.challenge, self._nonces = secrets.token_hex(16), set[str]()

    def check(self, request: Request) -> None:
        """Admit a request, once. Raises `Declined`."""
        path = request.scope["raw_path"].decode("latin-1")
        digest, challenge, nonce = (request.headers.get(name, "") for name in (DIGEST, CHALLENGE, NONCE))
        expected = signature(self._token, request.method, path, digest, challenge, nonce)
        signed = request.headers.get(SIGNATURE, "")
        if not secrets.compare_digest(expected.encode(), signed.encode("utf-8", "replace")):
            lines = f"method, path, {DIGEST}, {CHALLENGE} and {NONCE}"
            raise Declined(401, f"{SIGNATURE} is not the signature of {lines} with this server's token.")
        if challenge != self.challenge:
            raise Declined(
                401, f"{CHALLENGE} is outdated; read the new one from GET /healthz and sign it.", self.challenge
            )
        if not NONCES.fullmatch(nonce):
            raise Declined(401, f"{NONCE} needs 16 to 64 letters and digits, new ones for each request.")
        if nonce in self._nonces:
            raise Declined(401, "This request was sent before; sign it again with another nonce.")
        if len(self._nonces) >= REMEMBERED:
            self._begin()
        self._nonces.add(nonce)


class Turns:
    """Turns of those who have the token, so that none takes all of the server.

    Parameters
    ----------
    patience : s to wait for a turn.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self._busy: Counter[str] = Counter()
        self._waiting = 0
        self._changed = asyncio.Condition()

    @asynccontextmanager
    async def turn(self, client: str) -> AsyncIterator[None]:
        """A client's turn, when it comes. Raises `Declined`."""
        if self._waiting >= LINE:
            raise Declined(503, "Too many requests wait for their turn; try again in a moment.")
        self._waiting += 1
        try:
            async with asyncio.timeout(self._patience), self._changed:
                await self._changed.wait_for(lambda: self._busy[client] < EACH and self._busy.total() < TURNS)
                self._busy[client] += 1
        except TimeoutError as error:
            raise Declined(503, "The turn of this request did not come in time; try again in a moment.") from error
        finally:
            self._waiting -= 1
        try:
            yield
        finally:
            async with self._changed:
                self._busy[client] -= 1
                self._busy += Counter()  # forgets who has none
                self._changed.notify_all()
