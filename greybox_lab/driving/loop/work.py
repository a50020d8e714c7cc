"""A job of a server, as a unit of work in a process of its own: rows become a policy."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from greybox_id.base.errors import BadInput
from greybox_id.base.files import write_atomically
from greybox_id.base.json_data import finite
from greybox_id.datasets.read import read
from greybox_id.models.registry import motion_model_of
from greybox_id.models.vehicle import vehicle_text

from ..learned.injection import InjectedModel
from .adapting import adapted, foretold, last_rows, world_of
from .buffer import continued
from .checking import vehicle_of
from .protocol import digest_of
from .safety import caps_from
from .store import Job, ServerStore
from .swap import read_learned

ROWS = 20_000
"""The last rows of a session, that a model is made of."""
LEARNING = 0.8
"""Share of its budget after which learning ends with what was learned: the twin still has to be driven."""


def worked(job: dict[str, str], tell: Callable[[dict[str, Any]], None]) -> None:
    """Do the job `job` of the store in `folder`; tells what it is at as `said`, what went wrong as `failed`."""
    try:
        store = ServerStore(Path(job["folder"]))
        done(store, store.job(job["job"]), lambda sentence: tell({"said": sentence}))
    except BadInput as error:
        tell({"failed": str(error)})
    except MemoryError:
        raise
    except Exception as error:  # whatever rows lead to fails this job alone
        tell({"failed": f"It failed with {type(error).__name__}: {error}"[:400]})


def done(store: ServerStore, job: Job, say: Callable[[str], None]) -> None:
    """Do a job: its folder then holds policy.json and result.json, which is written last."""
    began = time.process_time()
    vehicle = vehicle_of(store.vehicle_text(job.session))
    start = read_learned(store.policy_file(job.policy).read_bytes(), store.job_folder(job.id))
    units = world_of(motion_model_of(vehicle), vehicle, 1, job.cap)
    recordings = continued([read(file) for file in store.row_files(job.session, job.rows)])
    learned, model, _ = adapted(
        vehicle, last_rows(recordings, ROWS), start, units, job.arm, steps=job.steps,
        cap=job.cap, seed=job.seed, say=say, stopped=lambda: time.process_time() - began > LEARNING * job.seconds,
    )  # fmt: skip
    say("driving in the twin")
    before = foretold(model.model, vehicle, start.policy.act, units, job.cap)
    after = foretold(model.model, vehicle, learned.policy.act, units, job.cap)
    by_cap = {job.cap: after}
    for cap in caps_from(job.cap):
        if cap not in by_cap:
            at = world_of(motion_model_of(vehicle), vehicle, 1, cap)
            by_cap[cap] = foretold(model.model, vehicle, learned.policy.act, at, cap)
    folder = store.job_folder(job.id)
    policy = learned.text()
    write_atomically(folder / "policy.json", policy, continued=True)
    result = {
        "policy": digest_of(policy.encode()),
        "detected": model.detected,
        "named": [dict(cause) for cause in model.named],
        "applied": dict(model.applied),
        "path_error_before": before.path_error,
        "path_error": after.path_error,
        "crashes": after.crashes,
        "foretold": [
            {"cap": cap, "path_error_rms": forecast.path_error, "worst": forecast.worst}
            for cap, forecast in by_cap.items()
        ],
        "vehicle": None if isinstance(model.model, InjectedModel) else vehicle_text(model.vehicle),
        "seconds": time.process_time() - began,
    }
    write_atomically(folder / "result.json", json.dumps(finite(result), allow_nan=False) + "\n", continued=True)
