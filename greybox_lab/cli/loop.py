"""`greybox loop` and `greybox serve`: drive, identify, name, learn anew, swap; here, or for vehicles that send rows."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from typing import Any

import click

from greybox_id.base.errors import BadInput
from greybox_id.cli.commands import CommandGroup
from greybox_id.cli.options import FILE, JSON, PATH, argument, command, option
from greybox_id.cli.output import console, print_json, progress, tell_result

from ..driving.loop.protocol import ARMS


@click.group(name="loop", cls=CommandGroup)
def loop() -> None:
    """Train a driving policy in simulation, and correct the simulation with the effects that greybox gap finds.

    \b
    greybox loop demo --quick --out loop
    """


SEED: Any = option("Seed of all random numbers.", type=click.IntRange(0, 10**6), default=0)
ARM: Any = option(
    "Way in which the training model is derived from the recording; docs/loop.md explains each.",
    type=click.Choice(ARMS),
    default="named",
)


@command("demo", of=loop)
def demo_command(
    out: Path = option("Folder for the results of the demo.", "FOLDER", required=True, type=PATH),
    quick: bool = option("Use fewer rows and fewer training steps; takes a few minutes."),
    case: int = option(
        "Simulated car, from 0 to 7; each has effects that its vehicle file does not state. In cases 6 and 7, "
        "greybox gap does not know these effects.",
        type=click.IntRange(0, 7),
        default=0,
    ),
    arm: str = ARM,
    cycles: int = option(
        "Number of cycles; each drives, diagnoses the gap and trains.", type=click.IntRange(1, 20), default=3
    ),
    seed: int = SEED,
    as_json: bool = JSON,
) -> None:
    """Run the whole loop with a simulated car: drive, diagnose the gap, train the policy again, test and replace it.

    After an interruption the same command continues.

    \b
    greybox loop demo --quick --out loop
    greybox loop demo --out loop --case 1 --arm actuator_net --json
    """  # fmt: skip
    from ..driving.loop.demo import demo

    with progress() as say:
        result = demo(out, quick=quick, case=case, arm=arm, seed=seed, cycles=cycles, say=say)
    tell_result(result, as_json)


@command("agent", of=loop)
def agent_command(
    server: str = argument("SERVER"),
    token_file: str = option(
        "File that holds the token with which requests are signed; the same as for greybox serve.",
        "FILE",
        required=True,
        type=FILE,
    ),
    out: Path = option(
        "Folder for the samples that are recorded and the policies that are received.",
        "FOLDER",
        required=True,
        type=PATH,
    ),
    session: str = option("Name of the session at the server: letters, digits and dashes.", default="car"),
    case: int = option("Simulated car, from 0 to 7, as in greybox loop demo.", type=click.IntRange(0, 7), default=0),
    arm: str = ARM,
    trainings: int = option("Number of trainings; each yields a policy.", type=click.IntRange(1, 20), default=2),
    steps: int = option("Number of steps of each training.", type=click.IntRange(1, 10_000_000), default=150_000),
    seed: int = SEED,
    as_json: bool = JSON,
) -> None:
    """Drive a simulated car, send its samples to SERVER, and drive with the policies that SERVER trains.

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


@command("serve")
def serve(
    token_file: str | None = option(
        "File that holds the token (16 characters or more) with which requests are signed.", "FILE", type=FILE
    ),
    host: str = option("Address of this machine at which the server listens.", default="127.0.0.1"),
    port: int = option(
        "Port at which the server listens; 0: any free port.", type=click.IntRange(0, 65535), default=8787
    ),
    out: Path = option(
        "Folder in which the server keeps sessions and policies.", "FOLDER", type=PATH, default=Path("greybox_serve")
    ),
    as_json: bool = JSON,
) -> None:
    """Run a server that receives samples from vehicles and sends them driving policies, until Ctrl-C.

    It first prints its address.

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
