"""A server that vehicles send rows to, and that learns policies from them; one thread, standard library only.

Who may ask: the signature of every request is checked before anything of its body is read, and its body against the
hash that was signed before anything is done with it. What goes wrong is a status and a sentence as JSON, and changes
nothing. Requests that change something are the same whether they come once or twice.
"""

from __future__ import annotations

import asyncio
import json
import re
import signal
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from http import HTTPStatus
from importlib import resources
from ipaddress import ip_address
from typing import Any, TypeAlias

from greybox_id.base.errors import BadInput
from greybox_id.base.files import held
from greybox_id.base.json_data import finite
from greybox_id.base.version import __version__

from .protocol import DIGEST, LARGEST, PROTOCOL, SIGNATURE, Declined, digest_of, is_signed
from .store import Busy, Full, Missing, ServerStore
from .workers import Workers

KEPT = 500
"""Events that who comes later is told."""
WAITING = 2000
"""Events that wait for a slow listener; older ones are dropped."""
LONGEST = 4000
"""Characters of an event; longer ones are not shown."""

PAGE = resources.files(__package__).joinpath("live.html").read_text("utf-8")


class Feed:
    """Events, and who follows them."""

    def __init__(self) -> None:
        self._past: deque[str] = deque(maxlen=KEPT)
        self._following: set[asyncio.Queue[str]] = set()

    def tell(self, event: Mapping[str, Any]) -> None:
        """Tell an event; its `time` is now, in s since 1970."""
        text = json.dumps(finite({"time": time.time(), **event}), allow_nan=False)
        if len(text) > LONGEST:
            return
        self._past.append(text)
        for own in self._following:
            if own.full():
                own.get_nowait()
            own.put_nowait(text)

    @contextmanager
    def followed(self) -> Iterator[asyncio.Queue[str]]:
        """A queue of events, those before it first."""
        own: asyncio.Queue[str] = asyncio.Queue(WAITING)
        for text in self._past:
            own.put_nowait(text)
        self._following.add(own)
        try:
            yield own
        finally:
            self._following.discard(own)


HEAD = 16 << 10
"""Bytes of a request's head at most."""
HEAD_SECONDS, BODY_SECONDS, DRAIN_SECONDS = 10.0, 60.0, 2.0
"""s in which a head and a body have to be there, and for which a body that is not wanted is listened to."""
CONNECTIONS = 64
LINE = re.compile(r"([A-Z]{1,10}) (/[!-~]{0,300}) HTTP/1\.[01]")
LOCAL = ("127.0.0.1", "localhost", "[::1]")
"""Names by which a browser of this machine calls it: a page elsewhere cannot read it through a name of its own."""
STATUSES = {Missing: 404, Busy: 409, Full: 507}
"""What is wrong -> status; other bad input has 422."""
JSON, BYTES, HTML = "application/json", "application/octet-stream", "text/html; charset=utf-8"

Answer: TypeAlias = "tuple[str, bytes]"
Handler: TypeAlias = "Callable[[tuple[str, ...], bytes], Awaitable[Answer]]"


class Server:
    """A server that is not yet listening.

    Parameters
    ----------
    store : what it keeps.
    token : that signs requests.
    host, port : where it listens; port 0 is any that is free.
    head_seconds, body_seconds : patience with slow clients.

    Attributes
    ----------
    address : "http://127.0.0.1:43121", once it listens.
    """

    def __init__(
        self, store: ServerStore, token: bytes, host: str = "127.0.0.1", port: int = 0, *,
        head_seconds: float = HEAD_SECONDS, body_seconds: float = BODY_SECONDS,
    ) -> None:  # fmt: skip
        self._store, self._token, self._host, self._port = store, token, host, port
        self._patience = head_seconds, body_seconds
        self._feed = Feed()
        self._workers = Workers(store, self._feed.tell)
        self._changing = asyncio.Lock()
        self._connections: set[asyncio.Task[None]] = set()
        self._began = time.time()
        self.address = ""
        name = r"([^/]{1,64})"
        self._routes: tuple[tuple[str, re.Pattern[str], Handler], ...] = (
            ("POST", re.compile(r"/v1/hello"), self._hello),
            ("POST", re.compile(r"/v1/policies"), self._policy),
            ("GET", re.compile(rf"/v1/policies/{name}"), self._policy_bytes),
            ("POST", re.compile(rf"/v1/sessions/{name}/rows"), self._rows),
            ("POST", re.compile(rf"/v1/sessions/{name}/train"), self._train),
            ("POST", re.compile(rf"/v1/sessions/{name}/events"), self._events),
            ("GET", re.compile(rf"/v1/jobs/{name}"), self._job),
        )

    async def run(self, ready: Callable[[str], None]) -> None:
        """Serve until SIGTERM or SIGINT; `ready` is told the address.

        Raises
        ------
        BadInput : it cannot listen there, or another server holds its folder.
        """
        with held(self._store.folder):
            await self._run(ready)

    async def _run(self, ready: Callable[[str], None]) -> None:
        stop, loop = asyncio.Event(), asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            with suppress(NotImplementedError, ValueError):  # Windows; a thread that is not the main one
                loop.add_signal_handler(number, stop.set)
        try:
            listening = await asyncio.start_server(self._accept, self._host, self._port, limit=HEAD)
        except (OSError, OverflowError) as error:
            raise BadInput(
                f"{self._host}:{self._port} cannot be listened at ({getattr(error, 'strerror', '') or error}); "
                "name another ‹port› or ‹host›; port 0 is any that is free."
            ) from error
        port = listening.sockets[0].getsockname()[1]
        self.address = f"http://{f'[{self._host}]' if ':' in self._host else self._host}:{port}"
        working = asyncio.create_task(self._workers.run())
        try:
            ready(self.address)
            waits = asyncio.create_task(stop.wait())
            await asyncio.wait([waits, working], return_when=asyncio.FIRST_COMPLETED)
            if working.done():  # it never ends by itself
                working.result()
        finally:
            listening.close()
            self._workers.kill()
            working.cancel()
            for own in (*self._connections, working):
                own.cancel()
            await asyncio.gather(*self._connections, working, return_exceptions=True)
            async with asyncio.timeout(1.0):  # what is being written is written
                await self._changing.acquire()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        if len(self._connections) >= CONNECTIONS:
            with suppress(OSError):
                await self._say(writer, Declined(503, "Too many are connected; try again in a moment."))
            writer.close()
            return
        self._connections.add(task)
        try:
            await self._answer(reader, writer)
        except (OSError, asyncio.CancelledError):  # gone; or the server ends
            pass
        finally:
            self._connections.discard(task)
            writer.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One request and its answer."""
        try:
            method, path, heads = await self._head(reader)
            if method == "GET" and path in ("/", "/events"):
                self._local(heads)
                if path == "/events":
                    await self._follow(reader, writer)
                else:
                    await self._write(writer, 200, HTML, PAGE.encode())
                return
            if (method, path) == ("GET", "/healthz"):
                await self._write(writer, 200, JSON, _json(self._health()))
                return
            kind, held = await self._done(method, path, heads, reader)
            await self._write(writer, 200, kind, held)
        except Declined as declined:
            await self._say(writer, declined)
            await self._drain(reader)
        except (OSError, asyncio.CancelledError):
            raise
        except Exception as error:  # a fault of ours ends this request alone
            await self._say(
                writer, Declined(500, f"This server has a fault ({type(error).__name__}); nothing changed.")
            )
            await self._drain(reader)

    async def _done(self, method: str, path: str, heads: Mapping[str, str], reader: asyncio.StreamReader) -> Answer:
        found = [(own, match, handler) for own, route, handler in self._routes if (match := route.fullmatch(path))]
        if not found:
            raise Declined(404, "There is nothing here; the paths begin with /v1/, and GET /healthz.")
        length = _length(method, heads)
        digest = heads.get(DIGEST.lower(), "")
        if not is_signed(self._token, method, path, digest, heads.get(SIGNATURE.lower(), "")):
            raise Declined(401, f"{SIGNATURE} is not this server's token's signature of method, path and {DIGEST}.")
        fitting = [(match, handler) for own, match, handler in found if own == method]
        if not fitting:
            raise Declined(405, f"{method} does nothing here; {found[0][0]} does.")
        body = await self._body(reader, length)
        if digest_of(body) != digest:
            raise Declined(422, f"The body's SHA-256 is not that of {DIGEST}; send it again.")
        match, handler = fitting[0]
        try:
            return await handler(match.groups(), body)
        except BadInput as error:
            raise Declined(STATUSES.get(type(error), 422), str(error)) from error

    async def _head(self, reader: asyncio.StreamReader) -> tuple[str, str, dict[str, str]]:
        try:
            async with asyncio.timeout(self._patience[0]):
                head = await reader.readuntil(b"\r\n\r\n")
        except TimeoutError as error:
            raise Declined(408, "The request's head did not come in time.") from error
        except asyncio.LimitOverrunError as error:
            raise Declined(431, f"The request's head is longer than {HEAD >> 10} kB.") from error
        except asyncio.IncompleteReadError as error:
            if not error.partial:
                raise ConnectionResetError from error
            raise Declined(400, "The request's head is cut short.") from error
        lines = head.decode("latin-1").split("\r\n")
        line = LINE.fullmatch(lines[0])
        if line is None:
            raise Declined(400, "This is no request of HTTP/1.1.")
        heads: dict[str, str] = {}
        for own in lines[1:-2]:
            name, colon, value = own.partition(":")
            key = name.lower()
            if not colon or not re.fullmatch(r"[!#$%&'*+.^_`|~0-9a-z-]+", key) or key in heads:
                raise Declined(400, "A header of this request is malformed, or there twice.")
            heads[key] = value.strip()
        return line[1], line[2], heads

    async def _body(self, reader: asyncio.StreamReader, length: int) -> bytes:
        try:
            async with asyncio.timeout(self._patience[1]):
                return await reader.readexactly(length)
        except TimeoutError as error:
            raise Declined(408, "The body did not come in time; send it again.") from error
        except asyncio.IncompleteReadError as error:
            raise Declined(400, f"The body is cut short: {len(error.partial)} of {length} bytes came.") from error

    def _local(self, heads: Mapping[str, str]) -> None:
        """Refuse the page to whoever is not on this machine."""
        host = heads.get("host", "").rpartition(":")[0] or heads.get("host", "")
        if not is_loopback(self._host) or host not in LOCAL:
            raise Declined(403, "The page is for this machine alone; serve on 127.0.0.1 and reach it through ssh -L.")

    def _health(self) -> dict[str, Any]:
        return {"status": "ok", "protocol": PROTOCOL, "version": __version__, "seconds": time.time() - self._began}

    async def _hello(self, _: tuple[str, ...], body: bytes) -> Answer:
        wanted = _object(body)
        parts = [wanted.get(name) for name in ("session", "vehicle", "policy")]
        if any(not isinstance(own, str) for own in parts):
            raise BadInput("A hello has session, vehicle (the text of its file) and policy (its SHA-256), all texts.")
        told = await self._changed(self._store.hello, *parts)
        self._feed.tell({"kind": "hello", "session": parts[0], "policy": parts[2]})
        return JSON, _json(told)

    async def _policy(self, _: tuple[str, ...], body: bytes) -> Answer:
        return JSON, _json({"sha256": await self._changed(self._store.add_policy, body)})

    async def _policy_bytes(self, found: tuple[str, ...], body: bytes) -> Answer:
        del body
        file = self._store.policy_file(found[0])
        return BYTES, await asyncio.to_thread(file.read_bytes)

    async def _rows(self, found: tuple[str, ...], body: bytes) -> Answer:
        told = await self._changed(self._store.add_rows, found[0], body)
        if told["new"]:
            self._feed.tell({"kind": "rows", "session": found[0], "rows": told["rows"]})
        return JSON, _json(told)

    async def _train(self, found: tuple[str, ...], body: bytes) -> Answer:
        job = await self._changed(self._store.ask, found[0], _object(body))
        self._workers.wake()
        self._feed.tell({"kind": "job", **_short(job.told())})
        return JSON, _json(job.told())

    async def _job(self, found: tuple[str, ...], body: bytes) -> Answer:
        del body
        job = await asyncio.to_thread(self._store.job, found[0])
        return JSON, _json({**job.told(), **self._workers.progress(job.id)})

    async def _events(self, found: tuple[str, ...], body: bytes) -> Answer:
        """Telemetry, triggers and swaps of a vehicle, to be shown; not kept."""
        await asyncio.to_thread(self._store.vehicle, found[0])
        events = _object(body).get("events")
        if not isinstance(events, list) or any(not isinstance(own, dict) or "kind" not in own for own in events):
            raise BadInput("Events are a list of objects, each with its kind.")
        for own in events:
            self._feed.tell({**own, "kind": str(own["kind"])[:40], "session": found[0]})
        return JSON, _json({"events": len(events)})

    async def _changed(self, change: Callable[..., Any], *given: Any) -> Any:
        """Change what is kept, one request at a time, and to its end even if its client is gone."""

        async def alone() -> Any:
            async with self._changing:
                return await asyncio.to_thread(change, *given)

        return await asyncio.shield(asyncio.ensure_future(alone()))

    async def _follow(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Events as they come, until nobody listens any more."""
        writer.write(b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\n\r\n")
        gone = asyncio.create_task(reader.read())
        try:
            with self._feed.followed() as events:
                while not gone.done():
                    wanted = asyncio.create_task(events.get())
                    await asyncio.wait([wanted, gone], return_when=asyncio.FIRST_COMPLETED, timeout=15.0)
                    said = f"data: {wanted.result()}\n\n" if wanted.done() else ": still here\n\n"
                    wanted.cancel()
                    writer.write(said.encode())
                    await writer.drain()
        finally:
            gone.cancel()

    async def _say(self, writer: asyncio.StreamWriter, declined: Declined) -> None:
        await self._write(writer, declined.status, JSON, _json({"error": str(declined)}))

    async def _write(self, writer: asyncio.StreamWriter, status: int, kind: str, held: bytes) -> None:
        head = (
            f"HTTP/1.1 {status} {HTTPStatus(status).phrase}\r\nContent-Type: {kind}\r\nContent-Length: {len(held)}\r\n"
            "Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n"
        )
        writer.write(head.encode() + held)
        async with asyncio.timeout(self._patience[1]):
            await writer.drain()
        if writer.can_write_eof():
            writer.write_eof()

    async def _drain(self, reader: asyncio.StreamReader) -> None:
        """Listen to the rest of what is not wanted for a while, so that the answer reaches who is still sending."""
        with suppress(TimeoutError, OSError):
            async with asyncio.timeout(DRAIN_SECONDS):
                while await reader.read(1 << 16):
                    pass


def is_loopback(host: str) -> bool:
    """Whether a host is this machine, as seen from itself alone."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


def _length(method: str, heads: Mapping[str, str]) -> int:
    """Bytes of the body."""
    if "transfer-encoding" in heads:
        raise Declined(411, "Send the body in one piece, with Content-Length.")
    told = heads.get("content-length", "0" if method == "GET" else "")
    if not re.fullmatch(r"\d{1,18}", told):
        raise Declined(411, "Content-Length has to say how many bytes the body has.")
    if int(told) > LARGEST:
        raise Declined(413, f"The body is larger than {LARGEST >> 20} MB; send it in parts.")
    return int(told)


def _object(body: bytes) -> dict[str, Any]:
    try:
        found = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"The body is no JSON ({error}).") from error
    if not isinstance(found, dict):
        raise BadInput("The body has to be one JSON object.")
    return found


def _json(body: Mapping[str, Any]) -> bytes:
    return json.dumps(finite(body), allow_nan=False).encode()


def _short(job: Mapping[str, Any]) -> dict[str, Any]:
    return {name: job[name] for name in ("id", "session", "arm", "status", "sentence", "result")}
