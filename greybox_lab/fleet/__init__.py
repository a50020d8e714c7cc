"""Fleets: thousands of recordings of many vehicles, checked, fitted and diagnosed; and what they say together.

A unit of work is one recording, done in a process of its own, on this machine or on the workers of a cluster. Results
are Parquet datasets, from which population, vehicles and drift are estimated without reading a recording again.

Examples
--------
>>> from greybox_lab import fleet
>>> sorted(fleet.__all__)
['estimate', 'report', 'run', 'status']
"""

from .estimate import estimate
from .report import report
from .run import run
from .status import status

__all__ = ["estimate", "report", "run", "status"]
