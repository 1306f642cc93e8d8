#!/usr/bin/env python3
"""Diagnosis of parts that are gripped and put down: time, mass, and bias meanwhile. python run.py [--count 40].

MuJoCo moves a hand with two fingers, which close on a part of 0.05 to 2 kg while the arm is at rest, carry it by
friction and release it, up to three times, or keep it. The log is diagnosed, the findings are applied to the setup, and
the same log is filtered with it.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import ftbias_jax as ft

sys.path.insert(0, str(Path(__file__).parents[1]))
from validation.generator.effects.effect import Effect
from validation.generator.effects.gripper import Gripper, Handover, Part, at_rest, carried, with_fingers
from validation.generator.make import write_log
from validation.generator.recording import Timeline, random_scene
from validation.generator.world import tool_path

LIGHTEST, HEAVIEST = 0.05, 2.0
"""kg: range of the mass of the part."""
SETTLED = 5.0
"""s after which the bias is evaluated; earlier, the prior dominates the estimate."""
NEAR = (-0.3, -0.1, 0.0, 0.1, 0.3, 1.0)
"""s relative to each grip or release at which the bias is evaluated separately."""


def random_gripper(scene, rng):
    """Random hand at the end of the tool, with 1.5 to 3 times the grip force that the part needs in this motion."""
    half = rng.uniform([0.005, 0.015, 0.015], [0.02, 0.03, 0.04])
    mass = float(np.exp(rng.uniform(*np.log([LIGHTEST, HEAVIEST]))))
    part = Part(mass, half, rng.uniform(-0.25, 0.25, 3) * half)
    middle = scene.belief.tool.com + rng.uniform([-0.01, -0.01, 0.04], [0.01, 0.01, 0.12])
    fastest = np.linalg.norm(tool_path(scene.world, scene.motion, scene.grid).acceleration(middle), axis=1).max()
    friction, lever = rng.uniform(0.5, 1.0), np.linalg.norm(part.center[1:]) / 0.015
    force = rng.uniform(1.5, 3.0) * mass * (9.81 + fastest) * (1 + lever) / (2 * friction)
    fingers, stroke = tuple(rng.uniform(0.03, 0.12, 2)), rng.uniform(0.008, 0.02)
    return Gripper(middle, fingers, stroke, max(force, 15.0), friction, part)


def random_handovers(scene, gripper, form, rng):
    """Random handovers while the arm rests long enough: one final grip, or one to three pairs of grip and release."""
    takes = rng.uniform(0.01, 0.15)
    low, high = (0.25, 0.75) if form == "once" else (0.05, 0.95)
    rests = [(a, b) for a, b in at_rest(scene) if b - a > gripper.closes + takes + 0.2]
    rests = [rest for rest in rests if low < rest[0] / scene.duration < high] or rests
    count = 1 if form == "once" or len(rests) < 2 else 2 * min(int(rng.integers(1, 4)), len(rests) // 2)
    chosen = sorted(rng.choice(len(rests), count, replace=False))
    handovers = []
    for first, last in (rests[k] for k in chosen):
        start = first + rng.uniform(0.06, last - first - gripper.closes - takes - 0.1)
        handovers.append(Handover(start, last - 0.01, takes, rng.uniform(-1e-3, 1e-3, 3)))
    return handovers


def recorded(seed, folder):
    """Write a log and its setup; return label, gripped part, and the true bias (T, 6) at stamps (T,) of the wrench."""
    seeds = np.random.SeedSequence([seed, 30]).spawn(7)
    rng = np.random.default_rng(seeds[0])
    motion = str(rng.choice(["moves", "trapezoids"]))
    duration, rate, pace = float(rng.uniform(30, 60)), float(rng.choice([125.0, 250.0, 500.0])), rng.uniform(0.7, 1.4)
    hand = random_scene(motion, duration, rate, pace, seeds[1:5])
    form, gripper = str(rng.choice(["once", "pick_and_place"])), random_gripper(hand, rng)
    handovers = random_handovers(hand, gripper, form, rng)
    wrench, center = carried(hand, gripper, handovers)
    center = center[np.isfinite(center[:, 0])]
    scene = with_fingers(hand, gripper)
    part = {
        "mass": gripper.part.mass,
        "at": [h.start + h.takes / 2 + (0 if k % 2 else gripper.closes) for k, h in enumerate(handovers)],
        "point": center.mean(0).tolist(),
        "slip": float(np.linalg.norm(np.ptp(center, axis=0))),
    }
    effect = Effect("gripped", form, part, sensor=lambda w: wrench)
    label, clean, _ = write_log(folder, "log", scene, [effect], Timeline(None, True, 0), seeds[5])
    return label, part, (scene.stamps, clean.bias)


def one(seed):
    """Simulate and diagnose one log, and compare the findings with the truth."""
    with tempfile.TemporaryDirectory() as folder:
        label, part, (stamps, bias) = recorded(seed, Path(folder))
        setup = ft.load_setup(Path(folder) / "log.toml")
        log = ft.read_log(Path(folder) / "log.npz", setup, raw=True)
        start = time.process_time()
        try:
            found = ft.diagnose(setup, [log])
        except ft.FtbiasError as error:
            return {"seed": seed, "robot": label["robot"], "mass": part["mass"], "refused": str(error)}
        row = {"seed": seed, "robot": label["robot"], "form": label["form"]["gripped"], "mass": round(part["mass"], 4)}
        row |= {
            "times": len(part["at"]),
            "slip_mm": round(1e3 * part["slip"], 2),
            "gap_sigmas": round(label["gap_sigmas"], 1),
            "verdict": found.verdict,
            "shrink": float(found.gap.shrink),
        }
        row |= {
            "causes": [cause.effect for cause in found.causes],
            "terms": [f"{x.drive} {x.form}" for x in found.terms],
        }
        row |= {"cpu_seconds": round(time.process_time() - start, 1)}
        term = found.terms[0] if found.terms else None
        if term is None or term.form != "payload":
            return row
        told = np.atleast_1d(term.parameters["time"])
        if len(told) == len(part["at"]):
            row["late_ms"] = round(1e3 * float(np.abs(told - part["at"]).max()), 1)
        row["mass_sigmas"] = round((term.coefficients["kg"] - part["mass"]) / term.stderr["kg"], 2)
        row["mass_error_percent"] = round(100 * (term.coefficients["kg"] / part["mass"] - 1), 2)
        row["point_mm"] = round(1e3 * float(np.linalg.norm(np.subtract(term.point, part["point"]))), 1)
        for name, stated in (("before", setup), ("after", found.apply(setup))):
            filtered = ft.filter_log(stated, Path(folder) / "log.npz")
            row[f"bias_{name}"] = inside(filtered, stamps, bias, np.arange(SETTLED, stamps[-1], 1.0))
            near = np.add.outer(part["at"], NEAR).ravel()
            row[f"bias_{name}_near"] = inside(filtered, stamps, bias, near[near < stamps[-1]])
        return row


def inside(result, stamps, bias, times):
    """Share of the bias within 3 standard deviations at given times (s), and its largest error in these units."""
    at = np.searchsorted(result.t + result.start, times)
    true = np.stack([np.interp(result.t[at] + result.start, stamps, one) for one in bias.T], 1)
    miss = np.abs(result.bias[at] - true) / result.bias_std[at]
    return {"inside": round(float((miss < 3).mean()), 4), "largest": round(float(miss.max()), 2)}


def table(rows):
    named = [row for row in rows if "mass_sigmas" in row]
    return {
        "logs": len(rows),
        "refused": sum("refused" in row for row in rows),
        "a load first": len(named),
        "described or explained": sum(row["verdict"] in ("described", "explained") for row in named),
        "beside other names": sum(bool(row["causes"]) for row in named),
        "all times within 0.1 s": sum(row.get("late_ms", np.inf) < 100 for row in named),
        "mass within three standard errors": sum(abs(row["mass_sigmas"]) < 3 for row in named),
        "largest error of the mass, percent": max((abs(row["mass_error_percent"]) for row in named), default=None),
        "median shrink": float(np.median([row["shrink"] for row in named])) if named else None,
        "bias inside three sigma, before": _mean(named, "bias_before"),
        "bias inside three sigma, after": _mean(named, "bias_after"),
        "near grips and releases, before": _mean(named, "bias_before_near"),
        "near grips and releases, after": _mean(named, "bias_after_near"),
    }


def _mean(rows, name):
    return round(float(np.mean([row[name]["inside"] for row in rows])), 4) if rows else None


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rows", type=Path, help="JSON lines of logs, done before and now, so that a run can go on")
    asked = parser.parse_args()
    done = asked.rows.read_text() if asked.rows and asked.rows.exists() else ""
    rows = [json.loads(line) for line in done.splitlines()]
    for number in range(len(rows), asked.count):
        rows.append(one(1000 * asked.seed + number))
        print(rows[-1], flush=True)
        if asked.rows:
            asked.rows.write_text("".join(json.dumps(row) + "\n" for row in rows))
    print(table(rows))
    from common import keep

    keep(__file__, {"seed": asked.seed, "table": table(rows), "logs": rows})
