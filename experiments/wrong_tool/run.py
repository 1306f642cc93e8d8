#!/usr/bin/env python3
"""A wrong tool and one further cause: are both named, is the tool right, and does the gap of another log shrink?

python run.py [--count 60] [--seed 1] [--jobs 1] [--rows ROWS.jsonl]. Logs are simulated by MuJoCo
(``experiments/validation``): two motions per robot, with the same tool and cause. The first log is diagnosed and the
findings are applied to the setup; the gap of the second log measures their benefit.
"""

import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import ftbias_jax as ft
from ftbias_jax.diagnosis.report.as_json import to_json
from ftbias_jax.diagnosis.thresholds import LEAST_SIGMAS
from ftbias_jax.model.effects.catalogue import CATALOGUE

sys.path.insert(0, str(Path(__file__).parents[1]))
from by_rows import by_rows

from validation.generator.effects.catalogue import ENTRIES, STATISTICAL
from validation.generator.effects.effect import Draw, Effect
from validation.generator.make import Limits, choose_motion, choose_timeline, write_log
from validation.generator.plan import Job
from validation.generator.recording import gap_rms, in_sigmas, random_scene
from validation.labels import read_labels
from validation.parameters import compare
from validation.rules import named, share
from validation.runs import gap_of

ASKED = ("low_pass", "time_delay", "crosstalk", "vibration", "cable")
FURTHER = ("gain", "hysteresis", "encoder_offset")
"""Further causes in addition to those required."""
FORMS = {"gain": ("one_channel",)}
"""Permitted forms, if not all: equal gains of all force channels are indistinguishable from a wrong mass."""
TOOL = {"tool_mass", "tool_com"}
SAME = {"clock_skew": "clock_drift"}
"""Form of a cause -> its effect in the catalogue: a growing delay is a clock drift."""
LIMITS = Limits((20.0, 40.0), (125.0, 200.0, 250.0, 400.0, 500.0), False)
PRINTED_FIELDS = (
    "index",
    "cause",
    "form",
    "own_gap",
    "verdict",
    "causes",
    "terms",
    "tool_within",
    "cause_named",
    "second",
)
LONGEST_DELAY = 0.2
"""s; ``check_setup`` reports a longer delay as a mistake of the clocks, and nothing is diagnosed."""
TRIES, NEAR = 8, 0.05
"""Largest number of iterations to scale the cause, and relative tolerance of its gap."""


def wrong_tool(rng, scene):
    """True tool: 5 to 25 % heavier or lighter than stated, its centre of mass displaced by 5 to 20 mm."""
    relative = rng.choice([-1, 1]) * rng.uniform(0.05, 0.25)
    shift = rng.uniform(0.005, 0.02) * Draw(rng, 0).direction()
    stated, grows = scene.belief.tool, rng.uniform() < 0.5
    mass, com = stated.mass * (1 + relative), stated.com + shift
    true = replace(stated, mass=mass, com=com, inertia=stated.inertia * (1 + grows * relative))
    return [
        Effect("tool_mass", "denser", {"mass": mass}, world=lambda world: replace(world, tool=true)),
        Effect("tool_com", "any_direction", {"com": com.tolist()}),
    ]


def sized(job, scene, seed, wanted):
    """The cause, scaled until its own gap has the wanted size in noise sigmas; a noise cause keeps its drawn size."""
    (name,), (form,) = job.names, job.forms
    scale = 1.0 if name in STATISTICAL else 0.3
    for _ in range(TRIES):
        cause = ENTRIES[name][0](form, Draw(np.random.default_rng(seed), job.level, scale), scene)
        gap = in_sigmas(scene, gap_rms(scene, [cause]))
        if name in STATISTICAL or abs(gap / wanted - 1) < NEAR:
            break
        scale *= float(np.clip(wanted / max(gap, 1e-9), 0.1, 10.0))
    return cause, gap


def make(folder, index, seed):
    """Write the two logs of a robot; return the label of the first."""
    seeds = np.random.SeedSequence([seed, 29, index]).spawn(12)
    rng = np.random.default_rng(seeds[0])
    cause = (ASKED + FURTHER)[index % len(ASKED + FURTHER)]
    form = str(rng.choice(FORMS.get(cause, ENTRIES[cause][1])))
    job = Job((cause,), (form,), int(rng.integers(3)))
    duration, rate = float(np.round(rng.uniform(*LIMITS.durations), 1)), float(rng.choice(LIMITS.rates))
    timeline = choose_timeline(False, rate, LIMITS.plain, rng)
    motions = [choose_motion(job, rng) for _ in range(2)]
    first, second = (
        random_scene(motion, duration, rate, pace, [seeds[1], *own])
        for (motion, pace), own in zip(motions, (seeds[2:5], seeds[5:8]), strict=True)
    )
    wanted = rng.uniform(0.5, 3.0)
    tool, (effect, own) = wrong_tool(rng, first), sized(job, first, seeds[8], wanted)
    while effect.parameters.get("delay", 0.0) > LONGEST_DELAY:  # a light tool reaches its gap only by a longer delay
        wanted /= 2
        effect, own = sized(job, first, seeds[8], wanted)
    label, *_ = write_log(folder, "log_000", first, [*tool, effect], timeline, seeds[9])
    # Vibration is drawn for each motion, while all other causes are properties of the robot.
    again = sized(job, second, seeds[8], wanted)[0] if cause in STATISTICAL else effect
    write_log(folder, "log_001", second, [*tool, again], timeline, seeds[10])
    (folder / "truth.json").write_text(json.dumps({"log_000": label}))
    return label | {"cause": cause, "motions": [kind for kind, _ in motions], "own_gap": own}


def one(index, seed):
    """Simulate a robot, diagnose its first log, and measure what the diagnosis does to the gap of the second."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        made = make(folder, index, seed)
        setup, began = ft.load_setup(folder / "log_000.toml"), time.process_time()
        first, second = (ft.read_log(folder / f"{name}.npz", setup, raw=True) for name in ("log_000", "log_001"))
        found = ft.diagnose(setup, [first])
        seconds = time.process_time() - began
        said = to_json(found)
        label = read_labels(folder, ["log_000"])["log_000"]
        before, after = (gap_of(stated, second) for stated in (setup, found.apply(setup)))
    compared = {(x.effect, x.parameter): x for x in compare(label, said) if x.effect in TOOL}
    off = {f"{effect}.{name}": (np.abs(x.error) / x.stderr).round(2).tolist() for (effect, name), x in compared.items()}
    form = made["form"][made["cause"]]
    tool = [compared.get(x) for x in (("tool_mass", "mass"), ("tool_com", "center_of_mass"))]
    return {
        "index": index,
        "cause": made["cause"],
        "form": form,
        "motions": made["motions"],
        "gap": round(made["gap_sigmas"], 2),
        "own_gap": round(made["own_gap"], 2),
        "verdict": said["verdict"],
        "causes": [cause["effect"] for cause in said["causes"]],
        "terms": [f"{term['drive']} {term['form']}" for term in said["terms"]],
        "tool_named": all(tool),
        "tool_within": all(x is not None and bool(x.inside.all()) for x in tool),
        "cause_named": any({made["cause"], SAME.get(form)} & names for names in named(said)),
        "faint": insignificant_parameters(found),
        "off": off,
        "second": [round(before, 4), round(after, 4)],
        "worse": after > before + LEAST_SIGMAS**2,
        "seconds": round(seconds, 1),
    }


def insignificant_parameters(found):
    """Parameters of named causes and terms that are within two standard errors of the value in the setup."""
    told = [
        (f"{cause.effect}.{p.name}", cause.parameters[p.name], cause.stderr[p.name], neutral)
        for cause in found.causes
        for p in CATALOGUE[cause.effect].parameters
        if p.name in cause.stderr and not callable(neutral := cause.nominal.get(p.name, p.neutral))
    ]
    told += [
        (f"{term.drive}.{unit}", value, term.stderr[unit], 0.0)
        for term in found.terms
        for unit, value in term.coefficients.items()
    ]
    off = {name: np.abs(np.subtract(value, neutral)) < 2 * np.asarray(stderr) for name, value, stderr, neutral in told}
    return [name for name, within in off.items() if within.all()]


def summary(rows):
    """Shares over all rows, over the required causes, and over each cause.

    ``cause_named``: named itself, or as one of at most three twins of a named cause; ``cause_itself``: without twins.
    ``more_named``: something is named beside tool and cause. ``faint``: a named parameter is within two standard
    errors of its value in the setup.
    """
    for row in rows:
        true = {row["cause"], SAME.get(row["form"])}
        row["cause_itself"] = not true.isdisjoint(row["causes"])
        row["more_named"] = len(set(row["causes"]) - TOOL) + len(row["terms"]) > 1
    groups = {"all": rows, "asked": [row for row in rows if row["cause"] in ASKED]}
    groups |= {cause: [row for row in rows if row["cause"] == cause] for cause in ASKED + FURTHER}
    shares = ("tool_named", "tool_within", "cause_named", "cause_itself", "more_named", "faint", "worse")
    return {
        name: {key: share(bool(row[key]) for row in some).plain() for key in shares} for name, some in groups.items()
    }


def main():
    seed, rows = by_rows(one, __doc__, 60, lambda row: {key: row[key] for key in PRINTED_FIELDS})
    from common import keep  # imported late, because it sets flags of JAX that the diagnosis should choose itself

    keep(__file__, {"seed": seed, **summary(rows), "rows": rows})


if __name__ == "__main__":
    main()
