"""The vehicle's side of the loop: drive, send rows, ask for a policy when it is time, try it, let it drive.

DIR/agent.json         what is asked for, what was driven and learned; what it is carried on from
DIR/vehicle.toml       as stated
DIR/base.json          the driver before any data
DIR/policy.json        in force
DIR/rows/              what was driven, see `buffer`
DIR/log.jsonl          every event
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from greybox_id.base.errors import BadInput, must_be_one_of, must_be_whole
from greybox_id.base.json_data import plain
from greybox_id.base.shorthands import Say
from greybox_id.datasets.recording import Recording
from greybox_id.models.registry import motion_model_of
from greybox_id.models.vehicle import parse_vehicle

from ..racing.draws import by_hand
from ..racing.policy import Policy
from .adapting import foretold
from .buffer import RowBuffer
from .client import Client, Unanswered
from .demo import CAP, Underway, Watched
from .protocol import ARMS
from .safety import Cap
from .scene import DrivenRows, Scene, driven, effect_words
from .state import LoopOutcome
from .store import DONE, FAILED
from .swap import Seat, must_drive_as_well
from .triggers import LEAST, InnovationBand, gap_told, path_error_beyond, rows_due

ROWS = LEAST
"""Commands of a drive, after which rows are sent and it is asked whether it is time to learn."""
BASE = 150_000
"""Steps in which the shipped driver is got used to the vehicle as its file states it."""
SHOWN = 25
"""Every so many-th row is shown at the server: two a second."""
POLL, PATIENCE = 0.5, 60.0
"""s between two questions whether a job is done, and for which a server that does not answer is asked again."""

Answer = TypeVar("Answer")


def agent(
    address: str, token: bytes, out: str | Path, *, case: int = 0, seed: int = 0, session: str = "car",
    arm: str = "named", trainings: int = 2, steps: int = BASE, seconds: float = 120.0,
    say: Say = lambda sentence: None,
) -> LoopOutcome:  # fmt: skip
    """Drive a car in simulation that has what its file does not state, with the help of a server.

    Parameters
    ----------
    address, token : of the server, see `client.Client`.
    out : folder; one in which the same was begun is carried on with.
    case, seed : of the vehicle in simulation, see `scene.CASES`, and of everything that is drawn.
    session : name at the server.
    arm : what the server makes of rows, one of `protocol.ARMS`.
    trainings : policies that are asked for before it ends.
    steps, seconds : of a training: periods driven, and the budget of the server's processor.
    say : told what is going on.

    Raises
    ------
    BadInput : the server does not answer or declines, the folder holds something else, or a number makes no sense.
    """
    must_be_whole(trainings, "trainings", 1, 20)
    must_be_one_of(ARMS, arm, "There is no arm")
    requested = {"case": case, "seed": seed, "session": session, "arm": arm, "trainings": trainings, "steps": steps,
             "seconds": seconds}  # fmt: skip
    return _Agent(Client(address, token), Path(out), requested, say).run()


class _Agent(Underway):
    def __init__(self, client: Client, folder: Path, requested: Mapping[str, Any], say: Say) -> None:
        self.client, self.requested = client, requested
        fresh = {"drives": [], "trainings": [], "cap": CAP, "clean": 0, "due": "", "foretold": [], "learned_at": 0,
                 "part": 0}  # fmt: skip
        scene = Scene(requested["case"])
        super().__init__(folder / "agent.json", "agent", requested, fresh | {"twin": None}, scene, say)
        self.buffer = RowBuffer(self.folder / "rows")
        self.buffer.forget(self.state["part"])
        self._known: tuple[Mapping[str, Any] | None, InnovationBand | None] = (None, None)

    def _run(self) -> LoopOutcome:
        self.client.get("/healthz")
        good = self.base(BASE).policy
        base, file = (self.folder / "base.json").read_bytes(), self.folder / "policy.json"
        seat = Seat(file.read_bytes() if file.is_file() else base, self.folder)
        self._hello(seat.now.sha, file.read_bytes() if file.is_file() else base)
        try:
            while len(self.state["trainings"]) < self.requested["trainings"]:
                reason = self.state["due"] or self._drive(seat, good)
                if reason:
                    self._train(seat, reason)
            self._drive(seat, good)
        finally:
            seat.close()
        body = self.body(drives=self.state["drives"], trainings=self.state["trainings"])
        return LoopOutcome(body, agent_lines(body))

    def _hello(self, sha: str, body: bytes) -> None:
        """Tell the server who drives, and by which policy."""
        self._asked(lambda: self.client.post("/v1/policies", body))
        hello = {"session": self.requested["session"], "vehicle": self.scene.text, "policy": sha}
        self._asked(lambda: self.client.post("/v1/hello", hello))

    def _asked(self, ask: Callable[[], Answer]) -> Answer:
        """An answer, asked for again where nobody answers: requests are the same whether they come once or twice."""
        until = time.monotonic() + PATIENCE
        while True:
            try:
                return ask()
            except Unanswered:
                if time.monotonic() > until:
                    raise
                time.sleep(POLL)

    @property
    def _path(self) -> str:
        return f"/v1/sessions/{self.requested['session']}"

    def _event(self, kind: str, **more: Any) -> None:
        """An event: written down, and shown at the server."""
        self.log.write(kind, **more)
        self._show([plain({"kind": kind, **more})])

    def _show(self, events: Sequence[Mapping[str, Any]]) -> None:
        """Let the server's page show events; without a server nobody sees them."""
        with suppress(Unanswered):
            self.client.post(f"{self._path}/events", {"events": events})

    def _send(self) -> None:
        """Send the rows that the server does not have."""
        self.buffer.send(lambda body: self.client.post(f"{self._path}/rows", body))

    def _shown(self, drive: DrivenRows, summary: Mapping[str, Any]) -> None:
        """Telemetry for the server's page."""
        events = [
            {
                "kind": "telemetry",
                "policy": summary["policy"],
                "cap": summary["cap"],
                "v_x": float(v_x),
                "e_y": float(e_y),
            }
            for episode in drive.episodes
            if episode.recording is not None
            for v_x, e_y in zip(
                episode.recording["v_x"][::SHOWN], episode.e_y[::SHOWN], strict=False
            )  # less before a crash
        ]
        self._show(events)

    def _drive(self, seat: Seat, good: Policy) -> str:
        """Drive and send the rows, which wait where nobody answers; why it is time to learn, "" where it is not."""
        k, cap = len(self.state["drives"]) + 1, Cap(self.state["cap"], clean=self.state["clean"])
        driven_at, units = cap.share, self.units(cap.share)
        expected = self._expected(seat.now.policy, driven_at)
        self.say(f"drive {k}: {ROWS} rows at {driven_at:.0%} of the grip")
        hands = Watched(units, seat, good, cap, self.units, expected["worst"], self.log)
        drive = driven(self.scene, hands, ROWS, 1000 * self.requested["seed"] + 100 * k)
        self.count(drive, cap, drive=k)
        recordings = drive.recordings
        for recording in recordings:
            self.buffer.add(recording, seat.now.sha, driven_at)
        try:
            self._send()
        except Unanswered as error:
            self.log.write("rows wait", reason=str(error))
        summary = {
            "rows": drive.rows,
            "cap": driven_at,
            "path_error_rms": drive.path_error,
            "path_error_foretold": expected["path_error_rms"],
            "lap_time": drive.lap_time,
            "crashes": drive.crashes,
            "events": hands.events,
            "policy": seat.now.sha,
        }
        self._shown(drive, summary)
        self._event("drive", number=k, **summary)
        self.state["drives"].append(summary)
        self.state["cap"], self.state["clean"], self.state["part"] = cap.share, cap.clean, self.buffer.last
        rows = sum(each["rows"] for each in self.state["drives"])
        new = rows - self.state["learned_at"]
        reason = rows_due(new, first=not self.state["learned_at"])
        if not reason and recordings and new >= LEAST:
            reason = path_error_beyond(drive.path_error, expected["path_error_rms"]) or self._evidence(recordings)
        self.state["due"] = reason if len(self.state["trainings"]) < self.requested["trainings"] else ""
        self.keep()
        return reason

    def _train(self, seat: Seat, reason: str) -> None:
        """Ask for a policy, try it, and let it drive."""
        requested, k = self.requested, len(self.state["trainings"]) + 1
        self.say(f"training {k}: {reason}")
        self._event("trigger", training=k, reason=reason)
        self._asked(self._send)
        request = {name: requested[name] for name in ("arm", "seconds", "steps")}
        request |= {"seed": requested["seed"] + k, "cap": self.state["cap"]}
        job = self._asked(lambda: self.client.post(f"{self._path}/train", request))
        place = f"/v1/jobs/{job['id']}"
        while job["status"] not in (DONE, FAILED):
            time.sleep(POLL)
            job = self._asked(lambda: self.client.get(place))
        refused, result = str(job["sentence"]), dict(job["result"])
        if job["status"] == DONE:
            sha = str(result["policy"])
            body = self._asked(lambda: self.client.policy(sha))
            refused = seat.refusal(body, sha, lambda new, present: must_drive_as_well(  # the server has driven both
                result["crashes"], result["path_error"], result["path_error_before"]
            ))  # fmt: skip
            if not refused:
                self._hello(sha, body)
                self.state["foretold"] = result["foretold"]
                self.state["twin"] = {"vehicle": result["vehicle"], "part": self.buffer.last}
                cap = Cap(self.state["cap"], clean=self.state["clean"])
                cap.next_cycle()
                self.state["cap"], self.state["clean"] = cap.share, cap.clean
        self._event("no swap" if refused else "swap", training=k, reason=refused)
        named, applied = result.get("named", []), result.get("applied", {})
        errors = {name: result.get(name) for name in ("path_error_before", "path_error")}
        self.state["trainings"].append(
            {"reason": reason, "job": job["id"], "named": named, "applied": applied, **errors, "refused": refused}
        )
        self.state["learned_at"] = sum(one["rows"] for one in self.state["drives"])
        self.state["due"] = ""
        self.keep()

    def _expected(self, policy: Policy, cap: float) -> Mapping[str, float]:
        """Path errors that are foretold at a cap: in the last twin, or at the nearest cap above that was driven there.

        Before anything of the vehicle is known it may be anything in the ranges of `by_hand`.
        """
        by_cap = self.state["foretold"]
        if not by_cap:
            result = foretold(self.nominal, self.vehicle, policy.act, self.units(cap), cap, by_hand())
            return {"path_error_rms": result.path_error, "worst": result.worst}
        above = [at for at in by_cap if at["cap"] >= cap - 1e-9]
        return min(above or by_cap, key=lambda at: abs(at["cap"] - cap))

    def _evidence(self, recordings: Sequence[Recording]) -> str:
        """Why the last drive is not that of the vehicle that is believed: the file's at first, then the last twin."""
        if self.state["twin"] is None:
            return gap_told(self.vehicle, recordings)
        return "" if (band := self._band()) is None else band.beyond(recordings)

    def _band(self) -> InnovationBand | None:
        """What innovations of the last twin were like on the rows that it was made of.

        None where networks act in it, which stay at the server, and where those rows are too few.
        """
        made = self.state["twin"]
        if made["vehicle"] is None:
            return None
        if self._known[0] != made:
            model = motion_model_of(parse_vehicle(made["vehicle"], self.folder / "twin.toml"))
            try:
                self._known = (made, InnovationBand.of(model, self.buffer.recordings(made["part"])))
            except BadInput as error:
                self.log.write("no band", reason=str(error))
                self._known = (made, None)
        return self._known[1]


def agent_lines(body: Mapping[str, Any]) -> list[str]:
    """What came of it, for a terminal."""
    lines = ["drive  rows  cap   path error  crashes  policy"]
    for k, drive in enumerate(body["drives"], 1):
        error = f"{1e3 * drive['path_error_rms']:7.1f} mm"
        lines.append(
            f"{k:5d}  {drive['rows']:4d}  {drive['cap']:.2f}  {error}  {drive['crashes']:7d}  {drive['policy'][:8]}"
        )
    for each in body["trainings"]:
        lines.append(
            f"learned ({each['reason']}): applied {effect_words(each['applied'])}; {each['refused'] or 'swapped'}"
        )
    return [*lines, f"written  {body['folder']}"]
