#!/usr/bin/env python3
"""Parts that are gripped and put down: when, how heavy, and is the bias right meanwhile? python run.py [--count 40].

MuJoCo carries the tool (``experiments/validation``); a part of 0.05 to 2 kg is taken up and put down up to three times,
or gripped once for good, in 0.01 to 0.15 s. The log is diagnosed, what was found is applied to the setup, and the same
log is filtered with it.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import ftbias_jax as ft

sys.path.insert(0, str(Path(__file__).parents[1]))
from validation.generator.effects.effect import Draw
from validation.generator.kinds.kind import plain
from validation.generator.kinds.plan import KINDS
from validation.generator.make import write_log
from validation.generator.recording import Timeline, random_scene

LIGHTEST, HEAVIEST = 0.05, 2.0
"""kg."""
SETTLED = 5.0
"""s after which a bias counts: before, its prior is what the filter knows."""


def recorded(seed, folder):
    """Write a log and its setup; what was gripped, and the true bias (T, 6) at the stamps (T,) of the wrench."""
    seeds = np.random.SeedSequence([seed, 30]).spawn(7)
    rng = np.random.default_rng(seeds[0])
    motion = str(rng.choice(["moves", "trapezoids"]))
    duration, rate, pace = float(rng.uniform(30, 60)), float(rng.choice([125.0, 250.0, 500.0])), rng.uniform(0.7, 1.4)
    scene = random_scene(motion, duration, rate, pace, seeds[1:5])
    kind, form = KINDS["gripped"], str(rng.choice(["once", "pick_and_place"]))
    part = kind.draw(form, Draw(rng, 1, 1.0), scene) | {
        "mass": float(np.exp(rng.uniform(*np.log([LIGHTEST, HEAVIEST]))))
    }
    effect = kind.build(form, plain(part), scene)
    label, clean, _ = write_log(folder, "log", scene, [effect], Timeline(None, True, 0), seeds[5])
    return label, part, (scene.stamps, clean.bias)


def one(seed):
    """One log: what was told of it, against the truth."""
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
            row[f"bias_{name}"] = inside(ft.filter_log(stated, Path(folder) / "log.npz"), stamps, bias)
        return row


def inside(result, stamps, bias):
    """Share of the bias within three of its standard deviations, and the largest miss in these, by the second."""
    at = np.searchsorted(result.t + result.start, np.arange(SETTLED, stamps[-1], 1.0))
    true = np.stack([np.interp(result.t[at] + result.start, stamps, one) for one in bias.T], 1)
    miss = np.abs(result.bias[at] - true) / result.bias_std[at]
    return {"inside": round(float((miss < 3).mean()), 4), "largest": round(float(miss.max()), 2)}


def table(rows):
    """What is told of all logs."""
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
    }


def _mean(rows, name):
    return round(float(np.mean([row[name]["inside"] for row in rows])), 4) if rows else None


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    rows = []
    for number in range(asked.count):
        rows.append(one(1000 * asked.seed + number))
        print(rows[-1], flush=True)
    print(table(rows))
    from common import keep

    keep(__file__, {"seed": asked.seed, "table": table(rows), "logs": rows})
