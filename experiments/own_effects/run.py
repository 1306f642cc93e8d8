#!/usr/bin/env python3
"""Does the diagnosis name effects of a user file, in logs from independent formulas? python run.py.

The effect is added to simulated logs in plain NumPy: poses as matrix products, velocities as finite differences.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

import ftbias_jax as ft

sys.path.insert(0, str(Path(__file__).parents[1]))
from random_setup import random_setup

HERE = Path(__file__).parent
NOISE = np.repeat([0.1, 0.004], 3)
RATE, DURATION = 125.0, 20.0


def poses(setup, q):
    """Rotation R (T, 3, 3) and position p (T, 3) m of the sensor, as a product of exponentials of the screw axes."""
    robot, sensor = setup.robot, setup.sensor
    R, p = np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3))
    for screw, angle in zip(robot.screws, q.T, strict=True):
        v, s = screw[:3], screw[3:]
        K = np.array([[0, -s[2], s[1]], [s[2], 0, -s[0]], [-s[1], s[0], 0]])
        a = angle[:, None, None]
        shift = (np.eye(3) * a + (1 - np.cos(a)) * K + (a - np.sin(a)) * K @ K) @ v
        p = p + np.einsum("tij,tj->ti", R, shift)
        R = R @ (np.eye(3) + np.sin(a) * K + (1 - np.cos(a)) * K @ K)
    zero = robot.flange_translation + robot.flange_rotation @ sensor.translation
    return R @ robot.flange_rotation @ sensor.rotation, p + R @ zero


def turning(R, t):
    """Angular velocity (T, 3) rad/s, sensor axes: the skew part of R^T dR/dt."""
    S = np.einsum("tji,tjk->tik", R, np.gradient(R, t, axis=0))
    return np.stack([S[:, 2, 1] - S[:, 1, 2], S[:, 0, 2] - S[:, 2, 0], S[:, 1, 0] - S[:, 0, 1]], 1) / 2


def pushed(R, force, point):
    """Change (T, 6) of the reading by a force on the tool, base axes, applied at a point of the sensor frame."""
    force = np.einsum("tji,tj->ti", R, force)
    return -np.hstack([force, np.cross(np.broadcast_to(point, force.shape), force)])


def changes(rng, setup, truth):
    """Name of the effect -> (parameters, change of the reading (T, 6)), each of random size."""
    R, p = poses(setup, truth.q)
    velocity, t = np.gradient(p, truth.t, axis=0), truth.t
    drag = {"coefficient": rng.uniform(1, 5), "point": rng.uniform(-0.05, 0.1, 3)}
    direction = rng.normal(size=3)
    place = p.mean(0) + rng.uniform(0.35, 0.6) * direction / np.linalg.norm(direction)
    magnet = {"strength": rng.uniform(0.2, 0.8), "place": place}
    rotor = {"momentum": rng.uniform(0.02, 0.1, 3) * rng.choice([-1, 1], 3)}
    gear = {
        "cosine": rng.uniform(0.1, 0.5, 6) * NOISE / 0.1,
        "sine": rng.uniform(0.1, 0.5, 6) * NOISE / 0.1,
        "teeth": float(rng.integers(5, 31)),
    }
    twist = {"stiffness": rng.uniform(0.01, 0.05)}
    away = place - p
    angle = gear["teeth"] * truth.q[:, 2, None]
    torque = np.cross(turning(R, t), rotor["momentum"])
    of_twist = np.zeros((len(t), 6))
    of_twist[:, 5] = twist["stiffness"] * truth.q[:, -1]
    return {
        "hose_drag": (drag, pushed(R, -drag["coefficient"] * velocity, drag["point"])),
        "magnet": (
            magnet,
            pushed(R, magnet["strength"] * away / ((away**2).sum(1) + 1e-4)[:, None] ** 1.5, np.zeros(3)),
        ),
        "rotor": (rotor, np.hstack([np.zeros_like(torque), torque])),
        "gear_ripple": (gear, gear["cosine"] * (np.cos(angle) - 1) + gear["sine"] * np.sin(angle)),
        "hose_twist": (twist, of_twist),
    }


def one(effects, name, seed):
    """Simulate a log with the effect, or without any, and return its diagnosis as a row."""
    rng = np.random.default_rng(seed)
    setup = random_setup(rng)
    motion = ("sines", "moves")[seed % 2]
    made = ft.simulate(setup, duration=DURATION, rate=RATE, motion=motion, seed=seed)
    true, change = changes(rng, setup, made.truth).get(name, ({}, np.zeros((len(made.truth.t), 6))))
    start = time.monotonic()
    found = ft.diagnose(setup, [made.log._replace(wrench=made.log.wrench + change)], effects=effects)
    row = {
        "true": name,
        "seed": seed,
        "motion": motion,
        "gap": float(np.sqrt(np.mean(((change - change.mean(0)) / NOISE) ** 2))),
        "verdict": found.verdict,
        "causes": [cause.effect for cause in found.causes],
        "twins": list(found.causes[0].indistinguishable_from) if found.causes else [],
        "seconds": round(time.monotonic() - start, 1),
    }
    named = next((cause for cause in found.causes if cause.effect == name), None)
    if named is not None:
        # Standard errors have a lower bound, because floating-point numbers resolve no less.
        errors = {key: np.ravel(np.asarray(named.parameters[key]) - true[key]) for key in true}
        sigmas = {key: errors[key] / np.maximum(np.ravel(named.stderr[key]), 1e-9) for key in true}
        row["sigmas"] = {key: np.round(value, 2).tolist() for key, value in sigmas.items()}
    return row


def table(rows):
    """Count how often each effect is named first, and how many parameters are within three standard errors."""
    found = {}
    for name in dict.fromkeys(row["true"] for row in rows):
        own = [row for row in rows if row["true"] == name]
        off = np.concatenate([np.abs(x) for row in own for x in row.get("sigmas", {}).values()] or [np.zeros(0)])
        found[name] = {
            "logs": len(own),
            "named first": sum(row["causes"][:1] == [name] for row in own),
            "explained": sum(row["verdict"] == "explained" for row in own),
            "parameters": len(off),
            "within three standard errors": int((off < 3).sum()),
        }
        if name == "none":
            found[name] = {"logs": len(own), "false alarms": sum(row["verdict"] != "none" for row in own)}
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=4, help="logs of each effect (%(default)s)")
    parser.add_argument("--none", type=int, default=6, help="logs without an effect (%(default)s)")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    own = ft.load_effects(HERE / "effects.py")
    names = [effect.name for effect in own]
    wanted = [name for _ in range(asked.count) for name in names] + ["none"] * asked.none
    rows = []
    for number, name in enumerate(wanted):
        rows.append(one(own, name, 1000 * asked.seed + number))
        print(rows[-1], flush=True)
    from common import keep

    keep(__file__, {"table": table(rows), "logs": rows})
