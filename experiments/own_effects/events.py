#!/usr/bin/env python3
"""User effects limited to a time interval or a region, and whether the diagnosis finds them: python events.py.

Three entries as the how-to page describes, with only units and bounds stated; logs of three robots with effects of
random size, time, duration and place. Each log is diagnosed with all three entries; the last logs have no effect.
"""

import argparse
import json
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from run import poses, random_setup

import ftbias_jax as ft

HERE = Path(__file__).parent
ROBOTS, MOTIONS = ("panda", "ur10e", "iiwa14"), ("sines", "moves")
RATE, DURATION, SOFT = 125.0, 40.0, 0.05
"""Hz; s; s, time constant of the onset of an event."""


def on(values, signals):
    """Share (T, 1) of an event's full strength."""
    ends = values["begin"] + values["length"]
    rises, falls = (signals.t - values["begin"]) / SOFT, (ends - signals.t) / SOFT
    return (jax.nn.sigmoid(rises) * jax.nn.sigmoid(falls))[:, None]


def press(values, signals, wrench):
    return wrench + signals.push(on(values, signals) * values["force"])


def drag(values, signals, wrench):
    away = (signals.path.position - values["place"]) / values["width"]
    near = jnp.exp(-(away**2).sum(1, keepdims=True) / 2)
    return wrench + signals.push(-values["coefficient"] * near * signals.path.velocity)


def grip(values, signals, wrench):
    begun = jax.nn.sigmoid((signals.t - values["begin"]) / SOFT)[:, None]
    held = signals.model.gravity - signals.path.acceleration  # at the sensor, because the part is small and near
    return wrench + signals.push(begun * values["mass"] * held, values["place"])


BEGIN = ft.Parameter("begin", "s", "when it begins", lower=0.0, scale=5.0, search=True)
EFFECTS = (
    ft.Effect(
        "press",
        "environment",
        (
            ft.Parameter("force", "N", "on the tool, base frame", (3,), scale=2.0),
            BEGIN,
            ft.Parameter("length", "s", "how long", (), 0.05, 20.0, 1.0, 1.0, search=True),
        ),
        "something presses at the tool for a while",
        "leave the tool alone",
        reading=press,
    ),
    ft.Effect(
        "region",
        "environment",
        (
            ft.Parameter("coefficient", "N s/m", "force per velocity in the middle", lower=0.0, scale=5.0),
            ft.Parameter("place", "m", "its middle, base frame", (3,), -2, 2, scale=0.2, search=True),
            ft.Parameter("width", "m", "standard deviation", (), 0.02, 1.0, 0.1, 0.1, search=True),
        ),
        "the tool is held back in one region of space",
        "look what is there",
        reading=drag,
    ),
    ft.Effect(
        "grip",
        "tool",
        (
            ft.Parameter("mass", "kg", "of the part, from then on", scale=0.2),
            BEGIN,
            ft.Parameter("place", "m", "of the part, sensor frame", (3,), -0.5, 0.5, scale=0.05, search=True),
        ),
        "a part was gripped",
        "state it as a payload",
        reading=grip,
    ),
)


def random_values(rng, name, positions):
    """Random parameters of an effect; positions: (T, 3) m, the path of the sensor."""
    direction = rng.normal(size=3)
    return {
        "press": {
            "force": rng.uniform(0.5, 5) * direction / np.linalg.norm(direction),
            "begin": rng.uniform(2, 33),
            "length": rng.uniform(0.5, 6),
        },
        "region": {
            "coefficient": rng.uniform(3, 20),
            "place": positions[rng.integers(len(positions))],
            "width": rng.uniform(0.05, 0.2),
        },
        "grip": {
            "mass": rng.uniform(0.05, 1.0),
            "begin": rng.uniform(5, 35),
            "place": np.array([0, 0, 0.1]) + rng.uniform(-0.04, 0.04, 3),
        },
    }.get(name)


def one(name, seed):
    """Simulate a log with the effect, or without any, and return its diagnosis as a row."""
    rng = np.random.default_rng(seed)
    robot, motion = ROBOTS[seed % 3], MOTIONS[seed // 3 % 2]
    setup = random_setup(rng, robot)
    way = ft.simulate(setup, duration=DURATION, rate=RATE, motion=motion, seed=seed).truth.q
    true = random_values(rng, name, poses(setup, way)[1])
    values = {name: {key: np.asarray(value).tolist() for key, value in true.items()}} if true else {}
    made = ft.simulate(setup, values, own=EFFECTS, duration=DURATION, rate=RATE, motion=motion, seed=seed)
    start = time.process_time()
    found = ft.diagnose(setup, [made.log], effects=EFFECTS)
    row = {"true": name, "seed": seed, "robot": robot, "motion": motion, "verdict": found.verdict}
    row |= {"causes": [cause.effect for cause in found.causes], "cpu_seconds": round(time.process_time() - start, 1)}
    if true and row["causes"][:1] == [name]:
        off = {key: np.abs(np.asarray(found.causes[0].parameters[key]) - value).max() for key, value in true.items()}
        row["off"] = {key: float(f"{value:.3g}") for key, value in off.items()}
    return row


def table(rows):
    """Count how often each effect is named first, with the largest error of its times, s."""
    found = {}
    for name in dict.fromkeys(row["true"] for row in rows):
        own = [row for row in rows if row["true"] == name]
        named = [row for row in own if "off" in row]
        times = [row["off"][key] for row in named for key in ("begin", "length") if key in row["off"]]
        found[name] = {"logs": len(own), "named first": len(named)}
        found[name] |= {"explained": sum(row["verdict"] == "explained" for row in named)}
        if times:
            found[name]["largest error of a time, s"] = max(times)
        if name == "none":
            found[name] = {"logs": len(own), "false alarms": sum(row["verdict"] != "none" for row in own)}
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=6, help="logs of each effect, and without any (%(default)s)")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    rows = []
    for name in (*(effect.name for effect in EFFECTS), "none"):
        for number in range(asked.count):
            rows.append(one(name, 1000 * asked.seed + number))
            print(rows[-1], flush=True)
    (HERE / "events.json").write_text(json.dumps({"table": table(rows), "logs": rows}, indent=1) + "\n")
