"""The server of the page: on this machine alone, for those who know the token, with nothing from the network."""

from __future__ import annotations

import asyncio
import secrets
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from nicegui import app, background_tasks, run, ui
from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .session import LARGEST
from .work import Work

HOST = "127.0.0.1"
CSS = Path(__file__).with_name("style.css")
TICK = 0.3
"""Seconds between looks at what runs."""


class Guard:
    """Lets requests through that bear the token, in the address once and as a cookie from then on.

    The host's name is looked at as well, so that no page elsewhere can reach this one under a name of its own; bodies
    are no larger than a recording may be.
    """

    def __init__(self, inner: ASGIApp, token: str, port: int) -> None:
        self.inner, self.token, self.hosts = inner, token, {f"{HOST}:{port}", f"localhost:{port}"}
        self.cookie = f"greybox_app_{port}"  # one per port: cookies do not tell ports apart

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, or refuse it with a sentence."""
        if scope["type"] not in ("http", "websocket"):
            await self.inner(scope, receive, send)
            return
        asked = HTTPConnection(scope)
        by_cookie, by_address = (
            secrets.compare_digest(place.encode(), self.token.encode())
            for place in (asked.cookies.get(self.cookie, ""), asked.query_params.get("token", ""))
        )
        origin, length = asked.headers.get("origin"), asked.headers.get("content-length", "0")
        status, words = 403, ""
        if asked.headers.get("host") not in self.hosts or not (by_cookie or by_address):
            words = "Open this page with the full address that greybox app printed, including its token."
        elif origin is not None and origin.removeprefix("http://") not in self.hosts:
            words = "Requests from other pages are refused."
        elif "transfer-encoding" in asked.headers or not length.isdecimal() or int(length) > LARGEST + 2**20:
            status, words = 413, f"A file of more than {LARGEST >> 20} MB is too large for this page."

        async def remembering(message: Message) -> None:
            if message["type"] == "http.response.start":
                value = f"{self.cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
                MutableHeaders(scope=message).append("set-cookie", value)
            await send(message)

        if not words:
            await self.inner(scope, receive, send if by_cookie else remembering)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse(words, status, {"cache-control": "no-store"})(scope, receive, send)


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
    from .steps import MODULES

    @ui.page("/", title=f"greybox app: {work.session.folder.name}", response_timeout=30)
    def index() -> None:
        ui.add_css(CSS)
        Page(work, MODULES).build()

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
