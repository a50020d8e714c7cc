"""What is freed goes back to the system."""

import subprocess
import sys

import pytest

SCRIPT = """
import numpy as np
{before}
def resident():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6
np.ones(3_500_000)  # 28 MB, freed: glibc's threshold follows
arrays, small, start = [], [], resident()
for _ in range(20):
    arrays.append(np.ones(1_000_000))
    small.append(np.ones(10_000))
del arrays
print(resident() - start)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc's")
def test_large_arrays_that_are_freed_between_small_ones_leave_nothing_behind():
    script = SCRIPT.format(before="from greybox_id.base.memory import give_back; give_back()")
    left = float(subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout)
    assert left < 20.0  # of 160 MB of large ones; the small ones take 2
