"""A session of the page: a folder that holds all that was done, and that the command line reads as well.

docs/app.md says what lies where. What is in memory is on disk before anybody sees it: a process may end at any moment.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from threading import RLock
from typing import Any

from greybox_id import BadInput

from .beneath import held, write_atomically
from .jobs import Jobs, PageJob

STATE = "recordings.json"
MAP = "map.toml"
LARGEST = 500 * 2**20
"""Bytes of a file that the page takes: reading one of text takes some three times that in memory."""
ROLES = {"train": "fit", "validate": "held out", "before": "before", "unused": "not used"}
"""Role of a recording -> what the page calls it."""

DEFAULTS: dict[str, Any] = {
    "recordings": [], "columns": "", "map": {}, "entries": [], "others": [], "maps": [], "joining": [], "between": "",
    "looked": "", "repairs": [], "horizon": None, "fit": "", "gap": "", "requests": {}, "taken": [], "step": 0,
    "cursor": None, "arena": "disc:10",
    "model": {"name": "", "vehicle": "", "settings": {}, "start": {}, "fix": [], "free": [], "effects": []},
}  # fmt: skip


@dataclass
class Session:
    """Everything about one session; changes are written at once, and count its version up, which every page watches.

    Who changes what it has read holds `changing` meanwhile: answers of commands are taken in a thread.
    """

    folder: Path
    state: dict[str, Any] = field(default_factory=dict)
    version: int = 0

    def __post_init__(self) -> None:
        self.folder = self.folder.resolve()
        try:
            (self.folder / "recordings").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BadInput(f"{self.folder}: no session can be kept there: {error.strerror}.") from error
        self.changing, self._held = RLock(), ExitStack()
        try:
            self._held.enter_context(held(self.folder))
        except BadInput as error:
            words = "is open in another greybox app: use its page, or name another session with --session."
            raise BadInput(f"{self.folder} {words}") from error
        self.jobs = Jobs(self.folder)
        self.state = json.loads(json.dumps(DEFAULTS)) | self._kept()

    def _kept(self) -> dict[str, Any]:
        path = self.folder / STATE
        if not path.is_file():
            return {}
        try:
            return dict(json.loads(path.read_text("utf-8")))
        except (OSError, ValueError, TypeError):
            raise BadInput(
                f"{path}: this is not a session of greybox app; name another session with --session."
            ) from None

    def __getitem__(self, key: str) -> Any:
        return self.state[key]

    def change(self, *, quietly: bool = False, **changes: Any) -> None:
        """Change some of the state: on disk first, then for every page, unless quietly, as a drag does it."""
        with self.changing:
            self.state = {**self.state, **changes}
            write_atomically(self.folder / STATE, json.dumps(self.state, indent=1, ensure_ascii=False) + "\n")
            self.version += 0 if quietly else 1

    def redraw(self) -> None:
        """Have every page draw its step anew."""
        with self.changing:
            self.version += 1

    def files(self, *roles: str) -> list[str]:
        """Paths of recordings in some roles, seen from the folder; of all that are used where no role is named."""
        chosen = roles or ("train", "validate", "before")
        return [each["file"] for each in self["recordings"] if each["role"] in chosen]

    def add(self, name: str) -> str:
        """Take a file that lies in `recordings/` into the session: the first is fitted, the second held out."""
        file = f"recordings/{name}"
        with self.changing:
            roles = {each["file"]: each["role"] for each in self["recordings"]}
            free = [role for role in ("train", "validate") if role not in roles.values()]
            roles.setdefault(file, free[0] if free else "train")
            self.change(recordings=[{"file": each, "role": role} for each, role in roles.items()])
        return file

    def link(self, path: Path) -> str:
        """A file that was named on the command line, as a link to it, or a copy where there are no links."""
        try:
            must_be_small(path.name, path.stat().st_size)
        except OSError as error:
            raise BadInput(f"{path} cannot be read: {error.strerror}.") from error
        place = self.folder / "recordings" / safe_name(path.name)
        if not (place.exists() and place.samefile(path)):
            place.unlink(missing_ok=True)
            try:
                place.symlink_to(path.resolve())
            except OSError:
                shutil.copyfile(path, place)
        return self.add(place.name)

    def next_folder(self, kind: str) -> str:
        """The next free `fits/N` or `gaps/N`."""
        taken = [int(each.name) for each in (self.folder / kind).glob("*") if each.name.isdecimal()]
        planned = [each.target for each in self.jobs.all() if each.target.startswith(f"{kind}/")]
        taken += [int(number) for target in planned if (number := target.split("/")[1]).isdecimal()]
        return f"{kind}/{max(taken, default=0) + 1}"

    @property
    def part(self) -> list[str]:
        """Options that say how recordings are read: the same for every command."""
        between = ["--between", self["between"]] if self["between"] else []
        return ["--columns", self["columns"] or "canonical", *between]

    @property
    def columns(self) -> str | Path:
        """The column map as `gb.read` takes it from any working folder."""
        return self.folder / MAP if self["columns"] == MAP else self["columns"] or "canonical"

    def start(self, kind: str, words: Sequence[str], target: str = "") -> PageJob:
        """Run a command of greybox, and show it on every page."""
        with self.changing:
            job = self.jobs.start(kind, words, target)
            self.redraw()
        return job

    def latest(self, kind: str, target: str = "") -> PageJob | None:
        """The last job of a kind."""
        return next((job for job in reversed(self.jobs.all()) if job.kind == kind and target in ("", job.target)), None)

    @property
    def key(self) -> str:
        """What a check was about: where it changes, recordings have to be looked at again."""
        used = [entry for entry in self["entries"] if entry["use"]]
        written = [place.stat().st_mtime for file in self.files() if (place := self.folder / file).is_file()]
        about = [self.files(), written, self["columns"], self["map"], used, self["between"]]
        return json.dumps(about, sort_keys=True)


def safe_name(name: str) -> str:
    """A file's name without folders and what no name should hold. Raises `BadInput` where nothing is left of it."""
    bare = re.split(r"[/\\]", name)[-1]
    bare = "".join(letter for letter in bare if letter.isprintable()).strip().lstrip(".-")[-120:]
    if not bare:
        raise BadInput(f"{name!r:.40} cannot be the name of a file; rename the file.")
    return bare


def must_be_small(name: str, size: int) -> None:
    """Raise `BadInput` for a file that is larger than the page takes."""
    if size > LARGEST:
        raise BadInput(
            f"{name} has more than {LARGEST // 2**20} MB, the most that this page takes. Cut it into parts: greybox "
            "data convert writes a part of a recording with --between."
        )


def named_session(files: Iterable[Path]) -> str:
    """A session's name, after its first file."""
    name = next((safe_name(file.name) for file in files), "drive")
    return re.sub(r"[^\w-]+", "_", name.split(".")[0]).strip("_") or "session"
