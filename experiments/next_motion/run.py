#!/usr/bin/env python3
"""Benefit of planned motions, on MuJoCo logs: python run.py [times|forecast|motions|twins ...]; all by default."""

import argparse
import json
import os
import subprocess
import time
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import jax
import numpy as np
from cases import (
    DURATION,
    ENTRIES,
    RATE,
    base,
    fitted,
    held_out_nats,
    home_in,
    make_case,
    make_effect,
    make_log,
    make_problem,
    make_scene,
    of_plan,
    values_of,
    wrong_tool,
)
from common import keep, rounded
from motions import all_motions

import ftbias_jax as ft
from ftbias_jax.errors import UsageError

TOOLS, EFFECTS = 30, ("gain", "tool_com", "gravity_tilt", "encoder_offset", "time_delay", "tool_mass")
"""Number of forecast cases of the tool, and the effects that share as many further cases."""
FORMS = {"tool_mass": "point_at_com", "mount_rotation": "sensor_and_tool"}
"""The generator's form of an effect, where it is not the first one of the effect."""
TRUE = {"gain": "gain", "tool_com": "com", "gravity_tilt": "gravity", "time_delay": "delay", "tool_mass": "mass"}
"""Name of the effect -> name of its parameter in the generator."""
REPEATS, ARMS = 3, 6
"""Number of logs per motion, and number of robots."""
TWINS = (
    ("time_delay", "low_pass"),
    ("low_pass", "time_delay"),
    ("time_delay", "tool_flexibility"),
    ("tool_flexibility", "time_delay"),
    ("tool_inertia", "tool_flexibility"),
    ("tool_flexibility", "tool_inertia"),
    ("gravity_tilt", "mount_rotation"),
    ("mount_rotation", "gravity_tilt"),
    ("gravity_tilt", "encoder_offset"),
    ("mount_rotation", "crosstalk"),
    ("tool_com", "gain"),
    ("tool_com", "crosstalk"),
)
"""True cause and the effect it may be confused with: twins of the catalogue that a motion can separate."""
WANTED, SEEDS = 20, 13
"""Number of cases wanted that the standard motion leaves as twins, and largest number of robots tried per pair."""
FIVE_SIGMA = 12.5


def form_of(name):
    return FORMS.get(name, ENTRIES[name][1][0])


def forecast_case(seed):
    """Errors of the identified values in units of the standard errors that the plan predicted, for one case."""
    name = "tool" if seed < TOOLS else EFFECTS[seed % len(EFFECTS)]
    belief, setup = make_case(seed)
    setup, home = home_in(setup, belief)
    if name == "tool":
        setup = wrong_tool(setup, belief)
    made = ft.plan(setup, name, duration=DURATION, rate=RATE, start=home, seed=seed)
    scene, told = make_scene(belief, of_plan(made), seed), made.forecast
    if name == "tool":
        found = ft.identify_tool(setup, make_log(setup, scene, [], seed)).tool
        inertia = belief.tool.inertia[np.triu_indices(3)]
        truth = np.concatenate([[belief.tool.mass], belief.tool.com, inertia])
        ratio = np.where(np.isfinite(found.stderr), found.values - truth, np.nan) / told.plan
    else:
        effect = make_effect(name, form_of(name), 0, scene, seed)
        problem, fit = fitted(setup, [make_log(setup, scene, [effect], seed)], name)
        values = values_of(problem, fit, name)
        if name == "encoder_offset":
            truth, value = np.zeros(len(home)), values["offset"]
            truth[effect.parameters["joint"] - 1] = effect.parameters["offset"]
        else:
            truth, value = (
                np.ravel(effect.parameters[TRUE[name]]),
                np.concatenate([np.ravel(x) for x in values.values()]),
            )
        ratio = (value - truth) / told.plan
    largest = made.used.max(1)
    return {
        "name": name,
        "arm": belief.arm.name,
        "ratios": ratio[np.isfinite(ratio)],
        "missing": int((np.isfinite(told.plan) & ~np.isfinite(ratio)).sum()),
        "shares": largest,
    }


def forecasts(count):
    """Standard deviation over all cases of the errors in units of the predicted standard errors."""
    cases = []
    for seed in range(count):
        began = time.monotonic()
        cases.append(forecast_case(seed))
        ratios = cases[-1]["ratios"]
        print(
            seed,
            cases[-1]["name"],
            cases[-1]["arm"],
            np.round(ratios, 1),
            f"{time.monotonic() - began:.0f} s",
            flush=True,
        )

    def spread(some):
        together = np.concatenate([case["ratios"] for case in some])
        return {"cases": len(some), "numbers": len(together), "std": together.std(), "rms": (together**2).mean() ** 0.5}

    names = dict.fromkeys(case["name"] for case in cases)
    return {
        "all": spread(cases),
        "expected_but_kept_by_identify": sum(case["missing"] for case in cases),
        "by_name": {name: spread([case for case in cases if case["name"] == name]) for name in names},
        "by_arm": {arm: spread([c for c in cases if c["arm"] == arm]) for arm in {c["arm"] for c in cases}},
        "largest_share_of_a_limit": float(np.max([case["shares"] for case in cases])),
    }


def motions_case(seed):
    """Expected standard errors, errors of the identified tool and errors of the final bias of every motion."""
    belief, setup = make_case(100 + seed)
    setup, home = home_in(setup, belief)
    wrong = wrong_tool(setup, belief)
    truth = np.concatenate([[belief.tool.mass], belief.tool.com, belief.tool.inertia[np.triu_indices(3)]])
    rows = {}
    for name, (motion, expected, share) in all_motions(wrong, home, belief.arm.span, seed).items():
        errors, bias = [], []
        for repeat in range(REPEATS):
            scene = make_scene(belief, motion, 1000 * repeat + seed)
            found = ft.identify_tool(wrong, make_log(wrong, scene, [], 1000 * repeat + seed)).tool
            errors.append(found.values - truth)
            bias.append(found.bias - scene.bias[-1])
        rms, of_bias = (np.sqrt(np.mean(np.square(x), 0)) for x in (errors, bias))
        rows[name] = {"expected": expected, "rms": rms, "bias_rms": of_bias, "share": share}
        times = [np.exp(np.log(rows[name][key] / rows["planned"][key]).mean()).round(2) for key in ("expected", "rms")]
        print(seed, belief.arm.name, name, *times, flush=True)
    return belief.arm.name, rows


def motions():
    """Geometric means over the ten parameters and the robots, as multiples of those of the planned motion."""
    cases = [motions_case(seed) for seed in range(ARMS)]
    names = cases[0][1]

    def against(kind, name):
        each = [np.exp(np.log(rows[name][kind] / rows["planned"][kind]).mean()) for _, rows in cases]
        return {"mean": float(np.exp(np.log(each).mean())), "least": min(each), "most": max(each)}

    kinds = ("expected", "rms", "bias_rms")
    return {
        "arms": [arm for arm, _ in cases],
        "times_the_planned": {name: {kind: against(kind, name) for kind in kinds} for name in names},
        "largest_share_of_a_limit": {name: float(max(rows[name]["share"] for _, rows in cases)) for name in names},
    }


def separated(setup, belief, motion, pair, seed):
    """nats gained on a held-out log by the true cause over its twin and over none, and the values fitted elsewhere."""
    scenes = [make_scene(belief, motion, noise) for noise in (seed, seed + 500)]
    effect = make_effect(pair[0], form_of(pair[0]), 0, scenes[0], seed)
    log, unseen = (
        make_log(setup, scene, [effect], scene_seed)
        for scene, scene_seed in zip(scenes, (seed, seed + 500), strict=True)
    )
    held_out, _ = make_problem(setup, [unseen])
    fits = [(name, *fitted(setup, [log], name)) for name in pair]
    true, twin, none = (held_out_nats(held_out, fit) for fit in (*(fit for *_, fit in fits), base(held_out)))
    return true - twin, true - none, {name: values_of(problem, fit, name) for name, problem, fit in fits}


def twins_case(pair, seed):
    """nats between twins after the standard motion, after the one planned from that log's fits, and as predicted."""
    belief, setup = make_case(200 + seed)
    setup, home = home_in(setup, belief)
    standard = all_motions(setup, home, belief.arm.span, seed, only=("moves",))["moves"][0]
    before, seen, values = separated(setup, belief, standard, pair, seed)
    if before >= FIVE_SIGMA or seen < FIVE_SIGMA:
        return before, None, None  # not twins, or the gap is too small to name any cause
    try:
        made = ft.plan(setup, ":".join(pair), duration=DURATION, rate=RATE, start=home, seed=seed, values=values)
    except UsageError as error:
        return before, str(error), None
    (expected,) = made.forecast.separates.values()
    return before, separated(setup, belief, of_plan(made), pair, seed)[0], expected


def twins():
    """Count how many of the cases that the standard motion leaves as twins are separated by the planned motion."""
    rows, found = [], 0
    for seed in range(SEEDS):
        for pair in TWINS:
            if found >= WANTED:
                break
            before, after, expected = twins_case(pair, seed)
            if after is not None:
                found += not isinstance(after, str)
                rows.append({"pair": ":".join(pair), "before": before, "after": after, "expected": expected})
            print(seed, pair, before, after, expected, flush=True)
    told = [row for row in rows if not isinstance(row["after"], str)]
    return {
        "left_as_twins": len(told),
        "separated": sum(row["after"] >= FIVE_SIGMA for row in told),
        "refused": sum(isinstance(row["after"], str) for row in rows),
        "cases": rows,
    }


def plain(x):
    """Round all numbers of a nested structure for a small JSON file."""
    if isinstance(x, dict):
        return {key: plain(value) for key, value in x.items()}
    if isinstance(x, (list, tuple)):
        return [plain(value) for value in x]
    return x if x is None or isinstance(x, (str, int)) else rounded(np.asarray(x), 3)


QUESTIONS = (
    "tool",
    "noise",
    "time_delay:low_pass",
    "gain:crosstalk",
    "tool_inertia:tool_flexibility",
    "tool_com:crosstalk",
    "gravity_tilt:encoder_offset",
)


def times():
    """Wall time (s) of ``ftbias plan`` of 20 s for the demonstration's Panda, with an empty cache and again."""
    rows = {}
    with TemporaryDirectory() as folder:
        run = partial(subprocess.run, cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        run(["ftbias", "demo", "--duration", "10"])
        for asked in QUESTIONS:
            environment, took = os.environ | {"XDG_CACHE_HOME": f"{folder}/{len(rows)}"}, []
            for _ in range(2):
                began = time.monotonic()
                command = ["ftbias", "plan", "--setup", "ftbias_demo/setup.toml", "--for", asked, "-o", "motion.csv"]
                run([*command, "--force"], env=environment)
                took.append(time.monotonic() - began)
            rows[asked] = dict(zip(("cold", "warm"), took, strict=True))
            print(asked, took, flush=True)
    return rows


PARTS = {"times": times, "forecast": partial(forecasts, 2 * TOOLS), "motions": motions, "twins": twins}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", choices=[[], *PARTS], default=[])
    jax.config.update("jax_enable_x64", True)
    path = Path(__file__).with_name("result.json")
    for part in parser.parse_args().parts or PARTS:
        found = plain(PARTS[part]())
        before = json.loads(path.read_text())["result"] if path.exists() else {}
        keep(__file__, before | {part: found})
