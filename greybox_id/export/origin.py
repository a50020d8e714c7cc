"""Where the entries of exported files come from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class KeyOrigin:
    """An entry of a file.

    Attributes
    ----------
    file : which.
    key : of the entry.
    value : in the file's unit; None where it is left open.
    behind : the parameter or effect it holds; "" where there is none.
    why : why it stands at a default or is left open, as a clause; "" where something is behind it.
    """

    file: str
    key: str
    value: float | str | bool | Sequence[float] | None
    behind: str = ""
    why: str = ""

    def plain(self) -> dict[str, Any]:
        """As plain data, for a manifest."""
        value = list(self.value) if isinstance(self.value, (list, tuple)) else self.value
        known = {"file": self.file, "key": self.key, "value": value}
        return known | ({"from": self.behind} if self.behind else {"default": self.why})
