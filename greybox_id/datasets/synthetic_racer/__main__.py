"""`python -m greybox_id.datasets.synthetic_racer --seed 20240 --out DIR` writes the synthetic racer's recordings."""

import argparse

from .files import SEED, make


def main() -> None:
    """Read the command line and write the files."""
    parser = argparse.ArgumentParser(
        prog="python -m greybox_id.datasets.synthetic_racer",
        description="Write racer_train.csv and racer_valid.csv, recordings of a synthetic 1:10 racing car.",
    )
    parser.add_argument("--seed", type=int, default=SEED, help=f"of lines, noise and sensor faults ({SEED})")
    parser.add_argument("--out", default=".", metavar="DIR", help="folder to write into (the current one)")
    chosen = parser.parse_args()
    for path in make(chosen.out, chosen.seed):
        print(path)


if __name__ == "__main__":
    main()
