"""The truck of the transfer-learning paper: ten seconds of free run, its Tables II to IV beside ours.

    python benchmarks/truck.py --data DIR [--quick] [--curves] [--seeds 5] [--out FILE] [--minutes N] [--json]

The same as `greybox bench truck`: DIR holds train.parquet and val.parquet, perhaps test.parquet, which is scored and
nothing else.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from greybox_id.base.errors import GreyboxError
from greybox_id.base.json_data import finite
from greybox_id.reports.text.screen import as_text
from greybox_lab.papers.kept import KeptBench
from greybox_lab.papers.truck import TruckOptions, truck_tables
from greybox_lab.papers.truck_report import tables


def main() -> int:
    """Run the benchmark; 2 on bad input."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--data", required=True, type=Path, help="folder of the recordings")
    arguments.add_argument("--quick", action="store_true", help="the smallest networks from one seed")
    arguments.add_argument("--seeds", type=int, default=5, help="trainings of each network")
    arguments.add_argument("--curves", action="store_true", help="learning curves and lessons, no other networks")
    arguments.add_argument("--out", help="file or folder that keeps trainings, to go on from")
    arguments.add_argument("--minutes", type=float, help="begin no training after so many")
    arguments.add_argument("--json", action="store_true", help="one JSON object on standard output")
    given = arguments.parse_args()

    def say(line: str, passing: bool = False) -> None:
        if not passing:
            sys.stderr.write(f"{line}\n")

    try:
        kept = KeptBench("truck", given.out, given.minutes)
        found = truck_tables(given.data, TruckOptions(given.quick, given.seeds, given.curves), say, kept)
    except (GreyboxError, OSError) as error:
        sys.stderr.write(f"truck: {error}\n")
        return 2
    except KeyboardInterrupt:
        return 130
    sys.stdout.write((json.dumps(finite(found), indent=1) if given.json else as_text(tables(found))) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
