"""Changes of the public Python names that break callers, beside the last release: a report, not a gate.

`python .ci/api_breaks.py [TAG]`; without one, beside the newest tag v*. Reads both versions without importing them.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def public(source: str) -> dict[str, str]:
    """Name at the top level -> where it is defined, of the text of greybox_id/__init__.py."""
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "_PLACES":
            places = ast.literal_eval(node.value)
            return {name: f"greybox_id.{place.replace(':', '.').rstrip('.')}" for name, place in places.items()}
    raise SystemExit("greybox_id/__init__.py has no table _PLACES.")


def breaks(before: str, now: str, old: object, new: object) -> list[str]:
    """Sentences: public names that are gone, and what changed of the others."""
    import griffe

    places, present = public(before), public(now)
    said = [f"gb.{name} is no longer at the top level" for name in places if name not in present]
    for change in griffe.find_breaking_changes(old, new):  # type: ignore[arg-type]
        path = change.obj.canonical_path
        for name, place in places.items():
            if path == place or path.startswith(f"{place}."):
                what = str(change.kind.value).lower()
                said.append(f"gb.{name}{path.removeprefix(place)}: {what}, {change.old_value} -> {change.new_value}")
    return list(dict.fromkeys(said))


def main() -> int:
    """Print the report."""
    import griffe

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()

    tags = sys.argv[1:2] or git("tag", "--list", "v*", "--sort=-creatordate").splitlines()[:1]
    if not tags:
        print("No release is tagged yet (v*): nothing to compare the public names with.")
        return 0
    old = griffe.load_git("greybox_id", ref=tags[0], repo=ROOT)
    new = griffe.load("greybox_id", search_paths=[ROOT], try_relative_path=False)
    before = git("show", f"{tags[0]}:greybox_id/__init__.py")
    now = (ROOT / "greybox_id" / "__init__.py").read_text(encoding="utf-8")
    said = breaks(before, now, old, new)
    print(f"Public names beside {tags[0]}: {len(said)} changes that break callers" + (":" if said else "."))
    print("\n".join(f"  {sentence}" for sentence in said))
    return 0


if __name__ == "__main__":
    sys.exit(main())
