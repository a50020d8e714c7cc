"""Public recordings that the package has column maps for: where their authors keep them, and under which licence.

Addresses name a commit where one is known: what lies there never changes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from urllib.parse import quote

from ..errors import BadInput, near_or_all


@dataclass(frozen=True)
class Remote:
    """A file at its source.

    Attributes
    ----------
    name : what it is called here.
    address : where it is fetched from.
    sha256 : of its bytes; empty where it is not known. It is then written down at the first fetch and compared later.
    """

    name: str
    address: str
    sha256: str = ""


@dataclass(frozen=True)
class PublicDataset:
    """Recordings of one source.

    Attributes
    ----------
    name : what commands call it.
    about : what was recorded.
    source : the authors' page.
    licence : as the authors state it.
    reference : what to cite.
    columns : the shipped column map that fits.
    files : what can be fetched; empty where the files have no known address.
    joined : name of a CSV file whose columns the files are, one each; empty where each is a recording.
    """

    name: str
    about: str
    source: str
    licence: str
    reference: str
    columns: str
    files: tuple[Remote, ...] = field(default=())
    joined: str = ""


_ROBORACER = (
    "https://raw.githubusercontent.com/tonegas/nnodely-applications/ba4e6e4e3125192a37b55eeb90c93112176abbe1/"
    "vehicle/model_combined_vehicle_dynamics_RoboRacer/Dataset/"
)
_REVS = (
    "https://raw.githubusercontent.com/MBDS/sideslip-angle-vehicle-estimation/"
    "2a427a76c5eb41321e50c32d14ec54aa05a3b03e/datasets/20140222_01_01_03_250lm/"
)

PUBLIC: dict[str, PublicDataset] = {
    dataset.name: dataset
    for dataset in (
        PublicDataset(
            name="roboracer",
            about="RoboRacer 1:10 car, 20 Hz: training, validation, another tyre set, an added mass",
            source="https://github.com/tonegas/nnodely-applications",
            licence="none stated for the recordings: they are their authors'",
            reference="Mungiello et al., Vehicle dynamics learning from physics priors with model-structured neural "
            "networks",
            columns="roboracer",
            files=(
                Remote(
                    "train.csv",
                    _ROBORACER + quote("Complete Dynamics/training/ftg_stanley_total_training.csv"),
                    "92989645a9223db3d4881fcd5450fe4885dd9b1fee3bf73cc8b0e2eeb8d19bc2",
                ),
                Remote(
                    "valid.csv", _ROBORACER + quote("Complete Dynamics/validation/ftg_stanley_total_validation.csv")
                ),
                Remote(
                    "tire_set_1.csv",
                    _ROBORACER + "Robustness/tire_set_1.csv",
                    "899218c34a55c45e512b2cb36b0fc03903149ff60547634b86b5cae9353ca38e",
                ),
                Remote("single_mass.csv", _ROBORACER + "Robustness/single_mass.csv"),
            ),
        ),
        PublicDataset(
            name="revs_250lm",
            about="Ferrari 250 LM on a race track, 100 Hz, sideslip measured by GPS-INS",
            source="https://github.com/MBDS/sideslip-angle-vehicle-estimation",
            licence="MIT; recorded in Stanford's REVS programme",
            reference="Kegelman, Harbott, Gerdes, Insights into vehicle trajectories at the handling limits: analysing "
            "open data from race car drivers, 2017",
            columns="revs_250lm",
            files=tuple(
                Remote(f"{column}.txt", f"{_REVS}{column}.txt")
                for column in ("t", "delta", "vx", "vy", "beta_true", "yawRate", "axCG", "ayCG")
            ),
            joined="run1.csv",
        ),
        PublicDataset(
            name="truck",
            about="Renault Premium truck, 200 Hz, 10 s trajectories: slalom, avoidance, constant radius",
            source="https://github.com/N9TT-9G0A-B7FQ-RANC/IEEE_RAL",
            licence="MIT",
            reference="Physics-guided approach with transfer learning in vehicle lateral dynamics",
            columns="truck",
        ),
    )
}
"""What `greybox datasets` knows."""


def public(name: str) -> PublicDataset:
    """A dataset by name. Raises `BadInput` where there is none."""
    if name not in PUBLIC:
        raise BadInput(f'There is no public dataset "{name}".{near_or_all(name, PUBLIC)}')
    return PUBLIC[name]
