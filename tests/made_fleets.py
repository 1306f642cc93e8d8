"""Made-up manifests of a fleet, as its commands would have written them over months."""

import json
from datetime import UTC, datetime, timedelta

import numpy as np

from ftbias_jax.fleet.entry import FAILED, LOSS, OK, Entry, LogState, Settings
from ftbias_jax.fleet.manifest import Manifest

START = datetime(2026, 1, 5, 8, tzinfo=UTC)
CALM = ("cell 1", "FT-01")
AGEING = ("cell 2", "FT-02")


def write_fleet(folder, count=60, seed=0):
    """Two robots for half a year; the second one's bias of fz ages, and its tool gets heavier in the second half."""
    rng = np.random.default_rng(seed)
    for robot, sensor in (CALM, AGEING):
        place = folder / robot.replace(" ", "_")
        place.mkdir(parents=True)
        old = (robot, sensor) == AGEING
        runs = {job: Settings(job, f"{robot} setup", {}, "1.0", f"{robot}.toml", robot, sensor) for job in JOBS}
        for job, settings in runs.items():
            with Manifest(str(place / f"manifest.{job}.jsonl")) as manifest:
                manifest.add("settings", settings._asdict())
                for i in range(count):
                    manifest.add_entry(_entry(job, settings, i, i / count, old, rng))
    return folder


JOBS = ("filter", "diagnose")


def _entry(job, settings, i, share, old, rng):
    name = f"{settings.robot}/{i:03d}"
    date = (START + timedelta(days=180 * share, hours=rng.uniform(0, 8))).isoformat()
    state = LogState(1000 + i, 10**18, 0, f"{name} sum")
    status = (FAILED if i == 7 else LOSS if i % 20 == 3 else OK) if job == "filter" else OK
    entry = Entry(f"logs/{name}.npz", f"{i:03d}.{job}", job, status, state=state, settings=settings.key, done=1e9 + i)
    if status == FAILED:
        return entry._replace(error=f"logs/{name}.npz: is not an NPZ file <cut>")
    bias = np.array([1.0, -2.0, 3.0, 0.1, -0.2, 0.05]) + rng.normal(size=6) * [0.1, 0.1, 0.1, 5e-3, 5e-3, 5e-3]
    bias[2] += 2.0 * share * old
    quality = {
        "filter": {
            "nis": 1 + 0.1 * rng.normal(),
            "one_second_error": [0.2, 0.2, 0.3, 0.01, 0.01, 0.01],
            "residual_std": list(0.1 + 0.01 * rng.random(6)),
            "bias": list(bias),
            "bias_std": [0.02, 0.02, 0.02, 1e-3, 1e-3, 1e-3],
            "gated_share": 0.01,
            "findings": [],
        },
        "diagnose": {
            "verdict": "explained" if old and share > 0.5 else "none",
            "causes": ["tool_mass"] if old and share > 0.5 else [],
            "terms": [],
            "gap_sigmas": 3.0 + share if old and share > 0.5 else 1.0,
            "shrink": 0.97,
        },
    }[job]
    return entry._replace(quality=json.loads(json.dumps({**quality, "date": date})))
