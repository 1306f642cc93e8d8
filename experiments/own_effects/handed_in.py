#!/usr/bin/env python3
"""Is the diagnosis the same if a catalogue entry is loaded from a user's file instead? python handed_in.py.

One log per entry, with the effect at a few times its typical size, is diagnosed with the built-in entry, and again with
the entry deleted from the catalogue and loaded from a file.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import jax
import numpy as np
from run import DURATION, RATE, random_setup

import ftbias_jax as ft
from ftbias_jax.model.effects.catalogue import typical_values
from ftbias_jax.model.effects.types import Model
from ftbias_jax.model.params import params_from_setup

jax.config.update("jax_enable_x64", True)
HERE = Path(__file__).parent
TIMES = 3.0
"""Size of the simulated effects, in typical departures from neutral."""
GIVEN = {
    "contact": {"force": [[6.0, -3.0, 4.0]], "start": [8.0], "end": [9.5]},
    "encoder_offset": {"joint": 2, "offset": 0.02},
    "bias_jump": {"amplitude": [3.0, -2.0, 4.0, 0.1, 0.2, -0.16], "time": 8.0, "ramp": 0.0},
    "warmup": {"amplitude": [3.0, -2.0, 4.0, 0.1, 0.2, -0.16], "tau": 6.0},
    "cable": {},
    "tool_flexibility": {},
    "time_delay": {"delay": 0.03},
    "clock_drift": {"rate": 2000.0, "offset": 0.01},
    "low_pass": {"cutoff": 3.0},
    "stamp_jitter": {"std": 0.01},
    "saturation": {},
    "noise_level": {},
    "vibration": {},
    "quantisation": {"step": [0.4, 0.4, 0.4, 0.02, 0.02, 0.02]},
    "gain": {"gain": [1.06, 1.0, 1.04, 1.0, 0.97, 1.0]},
    "outliers": {"rate": 0.01},
    "dropped_samples": {},
}
"""Values for effects whose typical departure cannot be scaled; {} = typical values."""
FILE = """
from ftbias_jax.model.effects import bias, environment, kinematics, sampling, sensor, tool

ENTRIES = (
    *tool.EFFECTS, *kinematics.EFFECTS, *environment.FLEXIBILITY, *environment.EFFECTS, *kinematics.MOUNTING,
    *sensor.EFFECTS, *bias.EFFECTS, *sensor.DELAY, *sampling.EFFECTS,
)
EFFECTS = [entry for entry in ENTRIES if entry.name == {name!r}]
"""


def sizes(setup, name):
    """Return the parameters with which ``simulate`` makes an effect."""
    effect = ft.CATALOGUE[name]
    params = params_from_setup(setup)
    model = Model(params.arm, params.gravity, params.theta)
    typical = typical_values(effect, model)
    if name in GIVEN:
        return {key: np.asarray(value).tolist() for key, value in (typical | GIVEN[name]).items()}
    neutral = {p.name: p.neutral(model) if callable(p.neutral) else p.neutral for p in effect.parameters}
    return {key: np.asarray(neutral[key] + TIMES * (value - neutral[key])).tolist() for key, value in typical.items()}


def compared_fields(found):
    """Return those parts of a diagnosis that are compared."""
    return {
        "verdict": found.verdict,
        "causes": [cause.effect for cause in found.causes],
        "twins": [list(cause.indistinguishable_from) for cause in found.causes],
        "terms": [f"{term.drive}, {term.form}" for term in found.terms],
        "shrink": round(found.gap.shrink, 3),
    }


def apart(first, second):
    """Largest parameter difference between two diagnoses, in standard errors; None = different causes or shapes."""
    largest = 0.0
    for one, other in zip(first.causes, second.causes, strict=False):
        if one.effect != other.effect:
            return None
        for key, value in one.parameters.items():
            if np.shape(value) != np.shape(other.parameters[key]):
                return None
            off = np.abs(np.subtract(value, other.parameters[key])) / (np.asarray(one.stderr.get(key, 1.0)) + 1e-6)
            largest = max(largest, float(np.max(off, initial=0)))
    return round(largest, 4)


def one(name, seed):
    """Compare the diagnoses of one log with an entry built in and loaded from a file."""
    start = time.process_time()
    setup = random_setup(np.random.default_rng(seed))
    log = ft.simulate(setup, {name: sizes(setup, name)}, duration=DURATION, rate=RATE, seed=seed).log
    built_in = ft.diagnose(setup, [log])
    every = ft.CATALOGUE._entries
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "my_effect.py")
        file.write_text(FILE.format(name=name))
        # The whole table is restored, because the order of the entries is the order in which they act.
        ft.CATALOGUE._entries = {other: entry for other, entry in every.items() if other != name}
        try:
            own = ft.load_effects(file)
            handed_in = ft.diagnose(setup, [log], effects=own)
        finally:
            ft.CATALOGUE._entries = every
    first, second = compared_fields(built_in), compared_fields(handed_in)
    same = {key: value for key, value in first.items() if key != "shrink"} == {
        key: value for key, value in second.items() if key != "shrink"
    }
    row = {"effect": name, "same": same, "built in": first, "apart": apart(built_in, handed_in)}
    if not same or first["shrink"] != second["shrink"]:
        row["handed in"] = second
    return row | {"cpu_seconds": round(time.process_time() - start, 1)}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(ft.CATALOGUE), help="entries (all)")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    kept = HERE / "handed_in.json"
    rows = {row["effect"]: row for row in json.loads(kept.read_text())} if kept.exists() else {}
    for name in asked.names:
        rows[name] = one(name, asked.seed)
        print(json.dumps(rows[name]), flush=True)
        kept.write_text(json.dumps([rows[name] for name in ft.CATALOGUE if name in rows], indent=1) + "\n")
    print(f"{sum(row['same'] for row in rows.values())} of {len(rows)} the same")
