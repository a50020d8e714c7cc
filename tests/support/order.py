"""Which tests run, and in what order."""

import hashlib
import math
from collections import defaultdict


def third(items, text):
    """Of a slow check repeated over three cases or more, and of all marked `examination`, a third; and all other tests.

    Which third is drawn by the text: every case is run by one commit in three, and the same commit runs the same.
    """
    families = defaultdict(list)
    for item in items:
        if "examination" in item.keywords:
            families["examinations"].append(item)
        elif "slow" in item.keywords:
            families[item.nodeid.partition("[")[0]].append(item)
    dropped = set()
    for cases in families.values():
        if len(cases) > 2:
            drawn = sorted(cases, key=lambda item: hashlib.sha256((text + item.nodeid).encode()).digest())
            dropped |= set(drawn[math.ceil(len(cases) / 3) :])
    return set(items) - dropped


def slow_first(items, workers):
    """The same tests in an order in which no slow one is left to the end, where the other workers have nothing to do.

    pytest-xdist gives each worker an equal part of the list, and later half of another's rest. So each part begins with
    modules that hold slow tests and ends with quick ones. Modules stay whole, since their tests share fixtures.
    """
    if workers < 2:
        return list(items)
    modules = defaultdict(list)
    for item in items:
        modules[item.nodeid.partition("::")[0]].append(item)
    parts, quick = [[] for _ in range(workers)], []
    slow_modules = 0
    for tests in modules.values():
        if any("slow" in item.keywords or "examination" in item.keywords for item in tests):
            parts[slow_modules % workers] += tests
            slow_modules += 1
        else:
            quick += tests
    for k, part in enumerate(parts):
        size = (len(items) - sum(map(len, parts[:k]))) // (workers - k)  # as it deals them out
        taken = max(size - len(part), 0)
        part += quick[:taken]
        del quick[:taken]
    return [item for part in parts for item in part] + quick
