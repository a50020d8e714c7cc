"""The server of the page: on this machine alone, for those who know the token, with nothing from the network."""

from __future__ import annotations

import asyncio
import secrets
import socket
from collections.abc import Awaitable, Callable, MutableMapping
from contextlib import suppress
from http.cookies import SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from nicegui import app, background_tasks, run, ui

from .session import LARGEST
from .work import Work

HOST = "127.0.0.1"
COOKIE = "greybox_app"
CSS = Path(__file__).with_name("style.css")
TICK = 0.3
"""Seconds between looks at what runs."""

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]


class Guard:
    """Lets requests through that bear the token, in the address once and as a cookie from then on.

    The host's name is looked at as well, so that no page elsewhere can reach this one under a name of its own; bodies
    are no larger than a recording may be.

    Parameters
    ----------
    inner : the application.
    token : what is known to who read the address.
    port : of the server.
    """

    def __init__(self, inner: Any, token: str, port: int) -> None:
        self.inner, self.token = inner, token
        self.hosts = {f"{HOST}:{port}", f"localhost:{port}"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, or refuse it with a sentence."""
        if scope["type"] not in ("http", "websocket"):
            await self.inner(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        cookie = SimpleCookie(headers.get("cookie", "")).get(self.cookie)
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        by_cookie = cookie is not None and secrets.compare_digest(cookie.value, self.token)
        by_address = secrets.compare_digest(given.encode(), self.token.encode())
        if headers.get("host") not in self.hosts or not (by_cookie or by_address):
            await self._refuse(
                scope, send, 403, "This page opens with the address that greybox app printed, token included."
            )
            return
        origin = headers.get("origin")
        if origin is not None and origin.removeprefix("http://") not in self.hosts:
            await self._refuse(scope, send, 403, "Another page asked for this one, and is not answered.")
            return
        length = headers.get("content-length", "0")
        if not length.isdecimal() or int(length) > LARGEST + 2**20:
            await self._refuse(scope, send, 413, f"A file of more than {LARGEST >> 20} MB is not taken here.")
            return
        await self.inner(scope, self._counted(receive), send if by_cookie else self._remembering(send))

    @property
    def cookie(self) -> str:
        """The cookie's name, one per port: cookies do not tell ports apart."""
        return f"{COOKIE}_{min(self.hosts).rpartition(':')[2]}"

    def _remembering(self, send: Send) -> Send:
        async def sent(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                value = f"{self.cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
                message["headers"] = [*message.get("headers", []), (b"set-cookie", value.encode())]
            await send(message)

        return sent

    @staticmethod
    def _counted(receive: Receive) -> Receive:
        taken = 0

        async def received() -> MutableMapping[str, Any]:
            nonlocal taken
            message = await receive()
            taken += len(message.get("body", b"")) if message["type"] == "http.request" else 0
            return {"type": "http.disconnect"} if taken > LARGEST + 2**20 else message

        return received

    @staticmethod
    async def _refuse(scope: Scope, send: Send, status: int, words: str) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
            return
        headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"cache-control", b"no-store")]
        await send({"type": "http.response.start", "status": status, "headers": headers})
        await send({"type": "http.response.body", "body": words.encode()})


def free_port() -> int:
    """A port that nobody listens at."""
    with socket.socket() as place:
        place.bind((HOST, 0))
        return int(place.getsockname()[1])


def set_up(work: Work) -> None:
    """Say what the page is; the server is started by who calls this."""
    from fastapi import HTTPException
    from fastapi.responses import FileResponse

    from .page import Page

    @ui.page("/", title=f"greybox app: {work.session.folder.name}", response_timeout=30)
    def index() -> None:
        ui.add_css(CSS)
        Page(work).build()

    @app.get("/session/{name:path}")
    def file(name: str) -> FileResponse:
        place = (work.session.folder / name).resolve()
        if not place.is_relative_to(work.session.folder) or not place.is_file() or name.startswith("recordings/"):
            raise HTTPException(404, "There is no such file in this session.")
        return FileResponse(place, headers={"Content-Security-Policy": "sandbox", "X-Content-Type-Options": "nosniff"})

    async def watch() -> None:
        await run.io_bound(work.watch)

    app.on_startup(lambda: app.timer(TICK, watch))
    app.on_shutdown(work.session.jobs.stop)


async def _listening(port: int, ready: Callable[[], None]) -> None:
    """Call once the page can be had."""
    while True:
        with suppress(OSError):
            _, writer = await asyncio.open_connection(HOST, port)
            writer.close()
            break
        await asyncio.sleep(0.02)
    ready()


def serve(work: Work, port: int, token: str, browser: bool, ready: Callable[[], None]) -> None:
    """Serve until Ctrl-C; `ready` is called once it listens."""
    set_up(work)
    app.on_startup(lambda: background_tasks.create(_listening(port, ready)))
    app.add_middleware(Guard, token=token, port=port)
    ui.run(
        host=HOST, port=port, title="greybox app", reload=False, show=f"/?token={token}" if browser else False,
        show_welcome_message=False, tailwind=False, uvicorn_logging_level="error", language="en-US", favicon="▞",
    )  # fmt: skip
