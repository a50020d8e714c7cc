"""A server that vehicles send rows to, and that learns policies from them, on Starlette and uvicorn (extra `serve`).

Who may ask: the signature of every request is checked before anything of its body is read, and its body against the
hash that was signed before anything is done with it. Bodies are read by processes with limits. What goes wrong is a
status and a sentence as JSON, and changes nothing. Requests that change something are the same whether they come once
or twice, but one that somebody overheard and sends again is refused.

Events of vehicles and jobs as they happen, for whoever watches the page.
"""

from __future__ import annotations

import asyncio
import errno
import json
import re
import signal
import socket
import time
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager, suppress
from functools import partial
from importlib import resources
from ipaddress import ip_address
from pathlib import Path
from typing import Any, TypeAlias, cast

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, Response, StreamingResponse
from starlette.routing import Route

from greybox_id.base.errors import BadInput, GreyboxError
from greybox_id.base.files import held
from greybox_id.base.json_data import finite
from greybox_id.base.version import __version__
from greybox_id.reports.html import style

from .admission import Admission, Connection, Strangers, Turns
from .bodies import BodyChecks, json_object
from .protocol import DIGEST, LARGEST, LARGEST_TEXT, PARQUET, PROTOCOL, Declined, digest_of
from .store import Busy, Full, Missing, ServerStore
from .workers import Workers

KEPT = 500
"""Past events that a viewer who comes later gets."""
WAITING = 2000
"""Events that wait for a slow viewer; older ones are dropped."""
LONGEST = 4000
"""Characters of an event; longer ones are not shown."""
VIEWERS = 8
"""Streams at a time: anybody on this machine may open one, so a further one ends the oldest."""
BEAT = 15.0
"""s of silence after which a stream says that it lives."""


class Feed:
    """Events, and who follows them."""

    def __init__(self) -> None:
        self._past: deque[str] = deque(maxlen=KEPT)
        self._viewers: dict[asyncio.Queue[str], Callable[[], None]] = {}

    def tell(self, event: Mapping[str, Any]) -> None:
        """Show an event; its `time` is now, in s since 1970."""
        text = json.dumps(finite({"time": time.time(), **event}), allow_nan=False)
        if len(text) > LONGEST:
            return
        self._past.append(text)
        for viewer in self._viewers:
            if viewer.full():
                viewer.get_nowait()
            viewer.put_nowait(text)

    async def stream(self, hang_up: Callable[[], None]) -> AsyncIterator[str]:
        """The past events, then those that come, as server-sent events.

        Parameters
        ----------
        hang_up : ends the viewer's connection, also one that takes nothing any more.
        """
        events: asyncio.Queue[str] = asyncio.Queue(WAITING)
        for text in self._past:
            events.put_nowait(text)
        if len(self._viewers) >= VIEWERS:
            self._viewers.pop(next(iter(self._viewers)))()
        self._viewers[events] = hang_up
        try:
            while True:
                try:
                    event = await asyncio.wait_for(events.get(), BEAT)
                except TimeoutError:
                    yield ": still here\n\n"
                else:
                    yield f"data: {event}\n\n"
        finally:
            self._viewers.pop(events, None)

    def close(self) -> None:
        """End all streams."""
        while self._viewers:
            self._viewers.popitem()[1]()


HEAD = 16 << 10
"""Bytes of a request's head at most."""
HEAD_SECONDS, BODY_SECONDS, DRAIN_SECONDS = 10.0, 60.0, 2.0
"""s in which a head and a body have to be there, and for which a body that is not wanted is listened to."""
BACKLOG = 128
LOCAL = ("127.0.0.1", "localhost", "[::1]")
"""Names by which a browser of this machine calls it: a page elsewhere cannot read it through a name of its own."""
STATUSES: Mapping[type[BadInput], int] = {Missing: 404, Busy: 409, Full: 507}
"""What is wrong -> status; other bad input has 422."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
HEADERS = {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff", "Connection": "close"}
HOST = re.compile(r"(?=.*[A-Za-z])[A-Za-z0-9]([A-Za-z0-9.-]{0,252})")

Answer: TypeAlias = "Mapping[str, Any] | bytes"
Handler: TypeAlias = "Callable[[Request, bytes], Awaitable[Answer]]"


class Server:
    """A server that is not yet listening.

    Parameters
    ----------
    store : what it keeps.
    token : that signs requests.
    host, port : where it listens; port 0 is any that is free.

    Attributes
    ----------
    address : "http://127.0.0.1:43121", once it listens.
    """

    def __init__(self, store: ServerStore, token: bytes, host: str = "127.0.0.1", port: int = 0) -> None:
        self._store, self._host, self._port = store, host, port
        self._strangers, self._admission, self._turns = Strangers(HEAD_SECONDS), Admission(token), Turns(BODY_SECONDS)
        self._feed, self._checks = Feed(), BodyChecks()
        self._workers = Workers(store, self._feed.tell)
        self._changing = asyncio.Lock()
        self._began = time.time()
        self._is_local = False
        self.address = ""

    async def run(self, ready: Callable[[str], None]) -> None:
        """Serve until SIGTERM or SIGINT; `ready` is called with the address.

        Raises
        ------
        BadInput : it cannot listen there, or another server holds its folder.
        """
        with held(self._store.folder), listening(self._host, self._port) as sock:
            number = sock.getsockname()[1]
            self._is_local = ip_address(sock.getsockname()[0]).is_loopback
            self.address = f"http://{f'[{self._host}]' if ':' in self._host else self._host}:{number}"
            config = uvicorn.Config(
                self.application(), http=cast(Any, partial(Connection, self._strangers)), ws="none", lifespan="off",
                log_config=None, log_level="critical", access_log=False, server_header=False,
                h11_max_incomplete_event_size=HEAD, timeout_graceful_shutdown=1,
            )  # fmt: skip
            await self._serve(_Uvicorn(config), sock, ready)

    async def _serve(self, server: _Uvicorn, sock: socket.socket, ready: Callable[[str], None]) -> None:
        def stop() -> None:
            server.should_exit = True
            self._feed.close()
            self._checks.close()
            self._workers.close()

        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            with suppress(NotImplementedError, ValueError):  # Windows; a thread that is not the main one
                loop.add_signal_handler(number, stop)
        working = asyncio.create_task(self._workers.run())
        serving = asyncio.create_task(server.serve([sock]))
        ready(self.address)
        try:
            await asyncio.wait([serving, working], return_when=asyncio.FIRST_COMPLETED)
            if working.done():  # it never ends by itself
                working.result()
        finally:
            stop()
            working.cancel()
            await asyncio.gather(serving, working, return_exceptions=True)
            with suppress(TimeoutError):
                async with asyncio.timeout(1.0):  # what is being written is written
                    await self._changing.acquire()

    def application(self) -> Starlette:
        """All that it answers."""
        signed = self._signed
        routes = [
            Route("/", self._page),
            Route("/events", self._events_stream),
            Route("/healthz", self._health),
            Route("/v1/hello", signed(self._hello), methods=["POST"]),
            Route("/v1/policies", signed(self._policy), methods=["POST"]),
            Route("/v1/policies/{name}", signed(self._policy_bytes)),
            Route("/v1/sessions/{name}/rows", signed(self._rows, LARGEST), methods=["POST"]),
            Route("/v1/sessions/{name}/train", signed(self._train), methods=["POST"]),
            Route("/v1/sessions/{name}/events", signed(self._events), methods=["POST"]),
            Route("/v1/jobs/{name}", signed(self._job)),
        ]
        kinds: tuple[type[Exception], ...] = (GreyboxError, OSError, HTTPException, ClientDisconnect, Exception)
        return Starlette(routes=routes, exception_handlers=dict.fromkeys(kinds, _refusal))

    def _signed(self, handler: Handler, largest: int = LARGEST_TEXT) -> Callable[[Request], Awaitable[Response]]:
        """An endpoint that answers who has the token."""

        async def endpoint(request: Request) -> Response:
            try:
                self._admission.check(request)
                request.scope["connection"].trust()
                if request.method != "POST":
                    return _response(await handler(request, b""))
                if not request.headers.get("content-length", "0").isdigit():
                    raise Declined(411, "Content-Length has to say how many bytes the body has.")
                if int(request.headers.get("content-length", "0")) > largest:
                    raise Declined(413, f"The body is larger than {largest >> 20} MB; send it in parts.")
                client = request.client.host if request.client else ""
                async with self._turns.turn(request.path_params.get("name", client)):
                    return _response(await handler(request, await self._body(request, largest)))
            finally:
                await _drain(request)

        return endpoint

    async def _body(self, request: Request, largest: int) -> bytes:
        """The body that was signed."""
        body = bytearray()
        try:
            async with asyncio.timeout(BODY_SECONDS):
                async for piece in request.stream():
                    body += piece
                    if len(body) > largest:
                        raise Declined(413, f"The body is larger than {largest >> 20} MB; send it in parts.")
        except TimeoutError as error:
            raise Declined(408, "The body did not come in time; send it again.") from error
        request.state.is_complete = True
        if digest_of(bytes(body)) != request.headers.get(DIGEST):
            raise Declined(422, f"The body's SHA-256 is not that of {DIGEST}; send it again.")
        return bytes(body)

    def _must_be_local(self, request: Request) -> None:
        """Refuse the page to whoever is not on this machine."""
        host = request.headers.get("host", "")
        if not self._is_local or (host.rpartition(":")[0] or host) not in LOCAL:
            raise Declined(403, "The page is for this machine alone; serve on 127.0.0.1 and reach it through ssh -L.")

    async def _page(self, request: Request) -> Response:
        self._must_be_local(request)
        return HTMLResponse(PAGE, headers=HEADERS)

    async def _events_stream(self, request: Request) -> Response:
        self._must_be_local(request)
        connection = request.scope["connection"]
        connection.trust()
        events = self._feed.stream(connection.transport.abort)
        return StreamingResponse(events, headers={**HEADERS, "Content-Type": "text/event-stream"})

    async def _health(self, request: Request) -> Response:
        del request
        seconds, challenge = time.time() - self._began, self._admission.challenge
        about = {"status": "ok", "protocol": PROTOCOL, "version": __version__, "seconds": seconds}
        return _response({**about, "challenge": challenge})

    async def _hello(self, request: Request, body: bytes) -> Answer:
        del request
        hello = json_object(body)
        texts = [hello.get(name) for name in ("session", "vehicle", "policy")]
        if not all(isinstance(text, str) for text in texts):
            raise BadInput("A hello has session, vehicle (the text of its file) and policy (its SHA-256), all texts.")
        session, vehicle, policy = cast("list[str]", texts)
        try:
            encoded = vehicle.encode()
        except UnicodeEncodeError as error:
            raise BadInput("vehicle must be the text of a vehicle file.") from error
        if await asyncio.to_thread(self._store.is_new, session, vehicle, policy):
            async with self._staged("vehicle", encoded, ".toml"):
                pass
        answer = await self._change(self._store.hello, session, vehicle, policy)
        self._feed.tell({"kind": "hello", "session": session, "policy": policy})
        return cast(Answer, answer)

    async def _policy(self, request: Request, body: bytes) -> Answer:
        del request
        sha = digest_of(body)
        if not self._store.has_policy(sha):
            async with self._staged("policy", body, ".json") as (file, _):
                await self._change(self._store.add_policy, sha, file)
        return {"sha256": sha}

    async def _policy_bytes(self, request: Request, body: bytes) -> Answer:
        del body
        file = self._store.policy_file(request.path_params["name"])
        return await asyncio.to_thread(file.read_bytes)

    async def _rows(self, request: Request, body: bytes) -> Answer:
        session, sha = request.path_params["name"], digest_of(body)
        vehicle = await asyncio.to_thread(self._store.vehicle_text, session)
        if await asyncio.to_thread(self._store.rows_known, session, sha, len(body)):
            return {**await self._change(self._store.add_rows, session, sha, None), "rows": None}
        suffix = ".parquet" if body.startswith(PARQUET) else ".csv"
        async with self._staged("rows", body, suffix, vehicle) as (file, rows):
            answer = await self._change(self._store.add_rows, session, sha, file)
        self._feed.tell({"kind": "rows", "session": session, "rows": rows})
        return {**answer, "rows": rows}

    async def _train(self, request: Request, body: bytes) -> Answer:
        job = await self._change(self._store.train, request.path_params["name"], json_object(body))
        self._workers.wake()
        self._feed.tell({"kind": "job", **job.shown()})
        return cast(Answer, job.to_json())

    async def _job(self, request: Request, body: bytes) -> Answer:
        del body
        job = await asyncio.to_thread(self._store.job, request.path_params["name"])
        return {**job.to_json(), **self._workers.progress(job.id)}

    async def _events(self, request: Request, body: bytes) -> Answer:
        """Telemetry, triggers and swaps of a vehicle, to be shown; not kept."""
        session = request.path_params["name"]
        await asyncio.to_thread(self._store.vehicle_text, session)
        events = json_object(body).get("events")
        if not isinstance(events, list) or any(not isinstance(event, dict) or "kind" not in event for event in events):
            raise BadInput("Events must be a list of objects, each with its kind.")
        for event in events:
            self._feed.tell({**event, "kind": str(event["kind"])[:40], "session": session})
        return {"events": len(events)}

    @asynccontextmanager
    async def _staged(
        self, kind: str, body: bytes, suffix: str, vehicle: str = ""
    ) -> AsyncIterator[tuple[Path, int]]:  # fmt: skip
        """A checked file with a body, and how many rows it has; it is gone afterwards."""
        file = await asyncio.to_thread(self._store.stage, body, suffix)
        try:
            yield file, await self._checks.check(kind, file, vehicle)
        finally:
            file.unlink(missing_ok=True)

    async def _change(self, change: Callable[..., Any], *arguments: Any) -> Any:
        """Change what is kept, one request at a time, and to its end even if its client is gone."""

        async def alone() -> Any:
            async with self._changing:
                return await asyncio.to_thread(change, *arguments)

        return await asyncio.shield(asyncio.ensure_future(alone()))


LOOK = "/* the look of reports */"
PAGE = resources.files(__package__).joinpath("live.html").read_text("utf-8").replace(LOOK, style())


class _Uvicorn(uvicorn.Server):
    """Uvicorn, which leaves signals to who runs it."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Nothing."""
        yield


@contextmanager
def listening(host: str, port: int) -> Iterator[socket.socket]:
    """A socket that listens at an address or a name of this machine.

    Raises
    ------
    BadInput : nothing can listen there, or nobody named where.
    """
    try:
        ip_address(host)
    except ValueError as error:
        if not HOST.fullmatch(host):
            raise BadInput(
                f"‹host›: {host!r} is no address; name one of this machine, such as 127.0.0.1. 0.0.0.0 is all of them."
            ) from error
    try:
        family, *_, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        if ip_address(place[0]).is_unspecified and host not in ("0.0.0.0", "::"):
            raise BadInput(f"‹host›: {host!r} means all addresses of this machine; say so with 0.0.0.0.")
        sock = socket.create_server(cast("tuple[str, int]", place), family=family, backlog=BACKLOG)
    except (OSError, OverflowError, UnicodeError) as error:
        raise BadInput(
            f"{host}:{port} cannot be listened at ({getattr(error, 'strerror', '') or error}); "
            "name another ‹port› or ‹host›; port 0 is any free port."
        ) from error
    with sock:
        yield sock


async def _refusal(request: Request, error: Exception) -> Response:
    """A status and a sentence for what went wrong."""
    del request
    more = {"challenge": error.challenge} if isinstance(error, Declined) and error.challenge else {}
    status, sentence = _status(error)
    return _response({"error": sentence, **more}, status)


def _status(error: Exception) -> tuple[int, str]:
    system = _of_system(error)
    if system is not None and system.errno in FULL:
        return 507, "The disk of this server is full; nothing changed. Make room there, then send it again."
    if system is not None:
        return 500, f"This server cannot use its folder ({system.strerror or system}); nothing changed."
    if isinstance(error, Declined):
        return error.status, str(error)
    if isinstance(error, BadInput):
        return next((code for kind, code in STATUSES.items() if isinstance(error, kind)), 422), str(error)
    if isinstance(error, HTTPException):
        if error.status_code == 405:
            return 405, f"This path takes {(error.headers or {}).get('Allow', 'another method')} only."
        return error.status_code, "This path does not exist; the paths are GET /healthz and those that begin with /v1/."
    if isinstance(error, ClientDisconnect):
        return 400, "The body is cut short."
    return 500, f"This server has a fault ({type(error).__name__}); nothing changed."


def _of_system(error: BaseException | None) -> OSError | None:
    """What the system had against it, if that is what went wrong. Declined requests are nobody's but the client's."""
    while error is not None and not isinstance(error, Declined):
        if isinstance(error, OSError) and not isinstance(error, TimeoutError):
            return error
        error = error.__cause__
    return None


async def _drain(request: Request) -> None:
    """Listen to the rest of a body for a while, so that the answer reaches who is still sending."""
    with suppress(TimeoutError, ClientDisconnect):
        async with asyncio.timeout(DRAIN_SECONDS):
            while not getattr(request.state, "is_complete", False):
                message = await request.receive()
                request.state.is_complete = not message.get("more_body", False)


def _response(answer: Answer, status: int = 200) -> Response:
    if isinstance(answer, bytes):
        return Response(answer, status, HEADERS, "application/octet-stream")
    return Response(json.dumps(finite(answer), allow_nan=False), status, HEADERS, "application/json")
