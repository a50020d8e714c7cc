"""`python -m greybox_id.datasets.synthetic_simrod --seed 0 --out DIR` writes the synthetic SimRod's recordings."""

import argparse

from .files import write


def main() -> None:
    """Read the command line and write the files."""
    parser = argparse.ArgumentParser(
        prog="python -m greybox_id.datasets.synthetic_simrod",
        description="Write recordings of a synthetic SimRod and, in the folder truth, its tyres' forces.",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the sensors' noise (0)")
    parser.add_argument("--out", default=".", metavar="DIR", help="folder to write into (the current one)")
    chosen = parser.parse_args()
    for path in write(chosen.out, chosen.seed):
        print(path)


if __name__ == "__main__":
    main()
