"""`greybox loop` and `greybox serve`: drive, identify, name, learn anew, swap; here, or for vehicles that send rows."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

import click

from greybox_id.base.errors import BadInput
from greybox_id.cli.commands import CommandGroup
from greybox_id.cli.options import json_option
from greybox_id.cli.output import console, print_json, progress, tell_result

from ..driving.loop.protocol import ARMS


@click.group(name="loop", cls=CommandGroup)
def loop() -> None:
    """Let a learned driver adapt to its vehicle by the effects that `greybox gap` names.

    \b
    greybox loop demo --quick --out loop
    """


arm_option = click.option(
    "--arm",
    type=click.Choice(list(ARMS)),
    default="named",
    show_default=True,
    help="How the model on which the driver learns is identified from the recorded rows; docs/loop.md explains each "
    "way.",
)


@loop.command("demo")
@click.option("--out", required=True, metavar="FOLDER", type=click.Path(path_type=Path), help="Folder of the demo.")
@click.option("--quick", is_flag=True, help="Use fewer rows and steps; takes some minutes.")
@click.option(
    "--case",
    type=click.IntRange(0, 7),
    default=0,
    show_default=True,
    help="Number of the case: effects of the car that its file does not state. "
    "In cases 6 and 7, greybox gap cannot name them.",
)
@arm_option
@click.option(
    "--cycles", type=click.IntRange(1, 20), default=3, show_default=True, help="Number of cycles of the loop."
)
@click.option("--seed", type=click.IntRange(0, 10**6), default=0, show_default=True, help="Seed of all random numbers.")
@json_option
def demo_command(out: Path, quick: bool, case: int, arm: str, cycles: int, seed: int, as_json: bool) -> None:
    """Close the loop on a simulated car. After an interruption the same command continues.

    \b
    greybox loop demo --quick --out loop
    greybox loop demo --out loop --case 1 --arm actuator_net --json
    """  # fmt: skip
    from ..driving.loop.demo import demo

    with progress() as say:
        result = demo(out, quick=quick, case=case, arm=arm, seed=seed, cycles=cycles, say=say)
    tell_result(result, as_json)


@loop.command("agent")
@click.argument("server", metavar="SERVER")
@click.option(
    "--token-file", required=True, metavar="FILE", type=click.Path(), help="File of the token that signs requests."
)
@click.option("--out", required=True, metavar="FOLDER", type=click.Path(path_type=Path), help="Folder of the agent.")
@click.option(
    "--session", default="car", show_default=True, help="Name of the session at the server: letters, digits and dashes."
)
@click.option(
    "--case",
    type=click.IntRange(0, 7),
    default=0,
    show_default=True,
    help="Number of the case, as in greybox loop demo.",
)
@arm_option
@click.option(
    "--trainings", type=click.IntRange(1, 20), default=2, show_default=True, help="Number of policies to learn."
)
@click.option(
    "--steps",
    type=click.IntRange(1, 10_000_000),
    default=150_000,
    show_default=True,
    help="Number of steps of a training.",
)
@click.option("--seed", type=click.IntRange(0, 10**6), default=0, show_default=True, help="Seed of all random numbers.")
@json_option
def agent_command(
    server: str, token_file: str, out: Path, session: str, case: int, arm: str, trainings: int, steps: int, seed: int,
    as_json: bool,
) -> None:  # fmt: skip
    """Drive a simulated car, send its rows to SERVER, and drive with the policies that SERVER learns.

    SERVER is the address that `greybox serve` prints. After an interruption the same command continues.

    \b
    greybox loop agent http://127.0.0.1:8787 --token-file token.txt --out car
    """  # fmt: skip
    from ..driving.loop.agent import agent
    from ..driving.loop.protocol import read_token

    with progress() as say:
        result = agent(
            server, read_token(token_file), out, case=case, seed=seed, session=session, arm=arm, trainings=trainings,
            steps=steps, say=say,
        )  # fmt: skip
    tell_result(result, as_json)


@click.command(name="serve")
@click.option(
    "--token-file",
    metavar="FILE",
    type=click.Path(),
    help="File of the token that signs requests: 16 characters or more.",
)
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen at.")
@click.option("--port", type=click.IntRange(0, 65535), default=8787, show_default=True, help="Port; 0: any free port.")
@click.option("--out", metavar="FOLDER", type=click.Path(path_type=Path), default=Path("greybox_serve"),
              show_default=True, help="Folder of its state.")  # fmt: skip
@json_option
def serve(token_file: str | None, host: str, port: int, out: Path, as_json: bool) -> None:
    """Serve until stopped. The first line printed is the address.

    \b
    greybox serve --token-file token.txt --port 0
    """  # fmt: skip
    from ..driving.loop.protocol import MADE, read_token
    from ..driving.loop.store import ServerStore

    try:
        from ..driving.loop.server import Server
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn", "h11", "anyio"):
            raise
        raise BadInput("greybox serve needs Starlette and uvicorn; pip install 'greybox-id[serve]'.") from error
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
