"""The seven steps as what they do: a session, commands started in it, and what is taken of their answers.

Nothing here draws; nothing here computes what `gb` or a command computes.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any

import greybox_id as gb

from . import mapping
from .beneath import named_text, sentence, shipped_maps
from .jobs import PageJob
from .mapping import Entry
from .session import MAP, Session
from .traces import read

SMALL = 20 * 2**20
"""Bytes of a recording that every shipped map is tried on: a second or two."""
STEPS = ("Drop", "See", "Check", "Model", "Fit", "Why not", "Take away")


class Work:
    """What a session does, and keeps."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.trouble, self._watching, self._ahead = "", Lock(), ""

    def take(self, paths: Iterable[Path]) -> None:
        """Take files that were named on the command line, and look at them."""
        for path in paths:
            self.session.link(path)
        self.look()

    def take_racer(self) -> None:
        """Take the shipped racer: two drives, the second one held out."""
        self.take(Path(gb.datasets.shipped(name)) for name in ("racer_train", "racer_valid"))

    def look(self) -> None:
        """Ask `greybox data map` of the first recording what its columns may be."""
        files = self.session.files()
        looking = any(job.kind == "map" for job in self.session.jobs.running())
        if files and not self.session["columns"] and not looking:
            self._map(files[:1])

    def _map(self, files: list[str]) -> None:
        target = self._proposed()
        self.session.start("map", ["data", "map", *files, "--out", target], target)

    def _proposed(self) -> str:
        """A map that a command is going to write, for the session to take."""
        return f"jobs/proposed_{len(self.session.jobs.all()) + 1}.toml"

    def map_done(self, job: PageJob) -> None:
        """Take a proposal: what is decided into the map, the rest as questions."""
        session, answer = self.session, job.answer
        if answer is None:
            return
        base = mapping.base_of(session.folder / job.target, answer)
        entries = [{**each, "use": True if each["decided"] else None} for each in answer["signals"]]
        maps = [] if session["joining"] else self._maps_that_fit()
        with session.changing:
            if session["columns"] or job != session.latest("map"):
                return  # decided otherwise meanwhile
            more = {"others": answer["others"], "maps": maps}
            session.change(map=base, entries=entries, columns=MAP, looked="", **more)
            self.write_map()

    def _maps_that_fit(self) -> list[str]:
        files = [self.session.folder / file for file in self.session.files()]
        if not files or files[0].stat().st_size > SMALL:
            return []
        fitting = []
        for name in shipped_maps():
            with suppress(gb.GreyboxError):
                if name != "canonical" and read(files[0], name).has("v_x"):
                    fitting.append(name)
        return fitting

    def use_map(self, name: str) -> None:
        """Read the recordings through a shipped map."""
        self.session.change(columns=name, entries=[], looked="", repairs=[])

    def unmap(self) -> None:
        """Look at the columns again, in place of a shipped map."""
        self.session.change(columns="", entries=[], map={}, looked="")
        self.look()

    def answer(self, entry: Entry, **answer: Any) -> None:
        """Answer a question, or change an answer."""
        self.session.change(entries=mapping.answered(self.session["entries"], entry, **answer), looked="")
        self.write_map()

    def set_time(self, column: str, unit: str, nanoseconds: str = "") -> None:
        """Say which column is the time; `nanoseconds` holds what whole seconds leave."""
        time = {"column": column, "unit": unit} | ({"nanoseconds": nanoseconds} if nanoseconds else {})
        base = {key: value for key, value in self.session["map"].items() if key != "time_units"}
        others = [each for each in self.session["others"] if each not in (column, nanoseconds)]
        self.session.change(map={**base, "time": time}, others=others, looked="")
        self.write_map()

    def add_entry(self, column: str, signal: str) -> None:
        """Take a column that was left over for a signal."""
        entry = {
            "signal": signal, "column": column, "unit": "", "units": [], "sign": 1, "divide_by": 1.0, "decided": False,
            "reasons": ["you named it"], "use": None,
        }  # fmt: skip
        others = [each for each in self.session["others"] if each != column]
        self.session.change(entries=[*self.session["entries"], entry], others=others)

    def mapped(self) -> tuple[dict[str, Any], list[Entry]]:
        """Base and entries of the map, the session's or a shipped one."""
        name = self.session["columns"]
        shipped = "" if name == MAP else named_text(name, "columns", "column map")[0]
        return mapping.entries_of_map(shipped) if shipped else (self.session["map"], self.session["entries"])

    def set_hold(self, hold: str) -> None:
        """Say in the map how steering and drive run between rows; a shipped map becomes the session's."""
        session, looked = self.session, self.session["looked"] == self.session.key
        base, entries = self.mapped()
        base = {key: value for key, value in base.items() if key != "hold"} | ({"hold": hold} if hold else {})
        session.change(quietly=True, map=base, entries=entries, columns=MAP)
        self.write_map()
        session.change(looked=session.key if looked else "")  # no check is about it

    def write_map(self) -> None:
        """Write `map.toml`, where there is a time and a signal."""
        entries, base = self.session["entries"], self.session["map"]
        if {"time", "rate"} & base.keys() and any(entry["use"] for entry in entries):
            mapping.write_map(self.session.folder / MAP, base, entries)

    @property
    def ready(self) -> str:
        """What is left to be done before recordings can be read, as a sentence; "" where nothing is."""
        if not self.session.files():
            return "Drop a recording first."
        if not self.session["columns"]:
            return "The columns are being examined."
        if self.session["columns"] == MAP:
            if not {"time", "rate"} & self.session["map"].keys():
                return "Say which column is the time."
            if self.session["map"].get("time_units"):
                return "Say in which unit the time is."
            count = len(mapping.questions(self.session["entries"]))
            if count:
                return f"Answer {count} question{'s' if count > 1 else ''} about columns."
            if not any(entry["use"] for entry in self.session["entries"]):
                return "Name a column for a signal."
        return ""

    def recording(self, file: str) -> gb.Recording:
        """A recording as it is mapped and cropped. Raises `BadInput`."""
        return read(self.session.folder / file, self.session.columns, self.session["between"])

    def join(self) -> None:
        """Ask `greybox data map` of all files together, to join them on one clock."""
        files = self.session.files()
        self.session.change(joining=files, entries=[], map={}, others=[], columns="", looked="")
        self._map(files)

    def make_joined(self) -> None:
        """Join the files by the map as it is answered."""
        target = "recordings/joined.parquet"
        words = ["data", "join", *self.session["joining"], "--columns", MAP, "--out", target]
        (self.session.folder / target).unlink(missing_ok=True)
        self.session.start("join", words, target)

    def join_done(self, job: PageJob) -> None:
        """Take the joined recording in place of its parts."""
        session = self.session
        if job.answer is not None and session["joining"]:
            with session.changing:
                unused = [{**each, "role": "unused"} for each in session["recordings"]]
                recordings = [*unused, {"file": job.target, "role": "train"}]
                session.change(recordings=recordings, columns="canonical", looked="", joining=[])

    def check(self) -> PageJob:
        """Run `greybox data check` on everything that is used."""
        session = self.session
        return session.start("check", ["data", "check", *session.files(), *session.part], session.key)

    def repair(self) -> None:
        """Run `greybox data check --repair`: the map as findings would have it."""
        session, target = self.session, self._proposed()
        session.start("repair", ["data", "check", *session.files(), *session.part, "--repair", target], target)

    def repair_done(self, job: PageJob) -> None:
        """Take the map that was repaired, keep what is open, and check again."""
        answer, session = job.answer, self.session
        if answer is None or not answer["repair"]["written"]:
            return
        base, entries = mapping.entries_of_map((session.folder / job.target).read_text("utf-8"))
        known = self.recording(session.files()[0])
        entries = [entry for entry in entries if known.has(entry["signal"]) or not entry["more"].get("optional")]
        kept = [entry for entry in session["entries"] if not entry["use"]]
        repairs = [*session["repairs"], *answer["repair"]["changes"]]
        session.change(map=base, entries=[*entries, *kept], columns=MAP, looked="", repairs=repairs)
        self.write_map()
        self.check()

    def fit(self) -> PageJob:
        """Run `greybox fit`."""
        session, target = self.session, self.session.next_folder("fits")
        self._keep(target)
        job = session.start("fit", self.fit_words(target), target)
        session.change(fit=target)
        return job

    def gap(self, of_fit: bool, since: bool = False) -> PageJob:
        """Run `greybox gap`, of the fit or of the vehicle as it is stated; what changed since before."""
        session, target = self.session, self.session.next_folder("gaps")
        self._keep(target)
        words = self.gap_words(session["fit"] if of_fit else "", target, since)
        job = session.start("since" if since else "gap", words, target)
        session.change(gap=target)
        return job

    def _keep(self, target: str) -> None:
        """What a fit or a gap is made of, to be shown with it later."""
        session = self.session
        request = {"model": session["model"], "train": session.files("train"), "validate": session.files("validate")}
        session.change(requests=session["requests"] | {target: request})

    def fit_words(self, target: str) -> list[str]:
        """Words of `greybox fit`, as the model, its sliders and the recordings are now."""
        session, chosen = self.session, self.session["model"]
        fixed = {name: value for name, value in chosen["start"].items() if name in chosen["fix"]}
        started = {name: value for name, value in chosen["start"].items() if name not in fixed}
        words = ["fit", "--model", chosen["name"], *(["--vehicle", chosen["vehicle"]] if chosen["vehicle"] else [])]
        for option, pairs in (("--set", chosen["settings"]), ("--start", started), ("--fix", fixed)):
            for name, value in pairs.items():
                words += [option, f"{name}={value if isinstance(value, str) else repr(value)}"]
        for option, names in (("--free", chosen["free"]), ("--with", chosen["effects"])):
            words += [word for name in names for word in (option, name)]
        words += [*session.files("train"), *session.part]
        words += [word for file in session.files("validate")[:1] for word in ("--validate", file)]
        words += ["--horizon", repr(session["horizon"])] if session["horizon"] else []
        return [*words, "--seed", "0", "--out", target]

    def gap_words(self, fit: str, target: str, since: bool = False) -> list[str]:
        """Words of `greybox gap`: of a fit, or of the vehicle as it is stated where there is none."""
        session, chosen = self.session, self.session["model"]
        words = ["gap", *session.files("train"), *(["--since", *session.files("before")] if since else [])]
        words += ["--fit", f"{fit}/fit.json"] if fit else ["--model", chosen["name"]]
        words += ["--vehicle", chosen["vehicle"]] if chosen["vehicle"] else []
        words += [word for file in session.files("validate") for word in ("--held-out", file)]
        return [*words, *session.part, "--seed", "0", "--out", target]

    def result(self, kind: str) -> tuple[PageJob | None, dict[str, Any] | None]:
        """The job of the fit or the gap that is shown, and what it printed."""
        target = self.session[kind]
        kinds = ("gap", "since") if kind == "gap" else (kind,)
        jobs = [job for job in self.session.jobs.all() if job.kind in kinds and job.target == target]
        return (jobs[-1], jobs[-1].answer) if jobs and target else (None, None)

    DONE = {"map": map_done, "join": join_done, "repair": repair_done}  # noqa: RUF012

    def watch(self) -> bool:
        """Look after what runs; whether something ended since the last time."""
        if not self._watching.acquire(blocking=False):  # what the last look found is still being taken
            return False
        try:
            return self._watched()
        finally:
            self._watching.release()

    def _watched(self) -> bool:
        ended = False
        taken = set(self.session["taken"])
        for job in self.session.jobs.all():
            if job.folder.name in taken or job.running:
                continue
            self.trouble = job.failure
            done = self.DONE.get(job.kind)
            try:
                if done is not None:
                    done(self, job)
            except gb.GreyboxError as error:
                self.trouble = sentence(error)
            finally:  # who is killed before takes it the next time
                taken.add(job.folder.name)
                self.session.change(quietly=True, taken=sorted(taken))
            ended = True
        if ended:
            self.session.redraw()
        self._read_ahead()
        return ended

    def _read_ahead(self) -> None:
        """Read recordings as soon as they can be, so that no step waits for it; what is wrong is said there."""
        if self._ahead != self.session.key and not self.ready:
            self._ahead = self.session.key
            for file in self.session.files():
                with suppress(gb.GreyboxError):
                    self.recording(file)
