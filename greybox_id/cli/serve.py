"""`greybox serve`: a server that vehicles send rows to, and that learns policies from them."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

import click

from ..errors import BadInput
from .options import json_option
from .output import console, print_json


@click.command(name="serve")
@click.option("--token-file", metavar="FILE", type=click.Path(), help="What signs requests: 16 characters or more.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen at.")
@click.option("--port", type=click.IntRange(0, 65535), default=8787, show_default=True, help="0: any that is free.")
@click.option("--out", metavar="FOLDER", type=click.Path(path_type=Path), default=Path("greybox_serve"),
              show_default=True, help="Folder of its state.")  # fmt: skip
@json_option
def serve(token_file: str | None, host: str, port: int, out: Path, as_json: bool) -> None:
    """Serve until it is told to end; its address is the first line that it prints.

    \b
    greybox serve --token-file token.txt --port 0
    """  # fmt: skip
    from ..loop.protocol import MADE, read_token
    from ..loop.server import Server
    from ..loop.store import ServerStore

    if token_file is None:
        raise BadInput(f"Nobody is served without a token; name its file with --token-file, made with: {MADE}.")
    server = Server(ServerStore(out), read_token(token_file), host, port)

    def ready(address: str) -> None:
        if as_json:
            print_json({"address": address})
        else:
            console().print(address, markup=False, highlight=False, soft_wrap=True)
        sys.stdout.flush()

    asyncio.run(server.run(ready))
