"""`greybox app`: the page that does what the commands do."""

from __future__ import annotations

import secrets
import sys
from pathlib import Path

import click

from greybox_id import BadInput
from greybox_id.cli.options import json_option
from greybox_id.cli.output import console, print_json


@click.command(name="app")
@click.argument("files", nargs=-1, metavar="[RECORDING]...", type=click.Path())
@click.option(
    "--session", metavar="NAME", help="Session to continue or to start; default: the name of the first recording."
)
@click.option(
    "--home",
    default="app",
    show_default=True,
    metavar="FOLDER",
    help="Folder of all sessions; each has a subfolder.",
)
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the page; default: any free port.")
@click.option(
    "--browser/--no-browser", default=True, show_default=True, help="Whether to open the page in the browser."
)
@json_option
def app(files: tuple[str, ...], session: str | None, home: str, port: int, browser: bool, as_json: bool) -> None:
    """Check recordings, fit a model and find out why it deviates from the vehicle, in the browser of this machine.

    \b
    greybox app lap7.csv lap8.csv
    greybox app --no-browser

    The command prints the address of the page; whoever has this address can open the page. Without a RECORDING, the
    page offers example recordings. Each step runs a greybox command; the last step lists these commands. Results are
    written to a subfolder of --home with the name of the session.
    """  # fmt: skip
    try:
        import nicegui  # noqa: F401
        import tsdownsample  # noqa: F401
    except ImportError as error:
        raise BadInput(
            f"The page needs the extra app ({error.name} is missing): pip install 'greybox-id[app]'."
        ) from None
    from .server import HOST, free_port, serve
    from .session import Session, named_session, safe_name
    from .work import Work

    paths = [Path(file) for file in files]
    name = safe_name(session) if session else named_session(paths)
    work = Work(Session(Path(home) / name))
    if paths:
        work.take(paths)
    port, token = port or free_port(), secrets.token_urlsafe(16)
    address = f"http://{HOST}:{port}/?token={token}"

    def ready() -> None:
        if as_json:
            print_json({"address": address, "session": str(work.session.folder)})
        else:
            console().print(address, markup=False, highlight=False, soft_wrap=True)
        sys.stdout.flush()

    serve(work, port, token, browser, ready)
