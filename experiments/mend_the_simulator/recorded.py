"""The 95 % bands of simulators drawn from a diagnosis, on what follows in recorded logs of an ABB and a Panda.

FTBIAS_SHARED=FOLDER python experiments/mend_the_simulator/recorded.py writes recorded.json beside this script.
"""

import json
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax
import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "real_logs"))
from cases import abb, folder, panda
from run import covered, draws_of, read

import ftbias_jax as ft
from ftbias_jax.simulators.mended import OF_THE_ROBOT

STEPS = {"tune": ft.tune, "identify --bias": partial(ft.identify_tool, bias=True)}


def halves(setup, log):
    """The two halves of a log, each from 0 s."""
    cut = len(log.t) // 2
    for part in (slice(0, cut), slice(cut, None)):
        arrays = {name: getattr(log, name)[part] for name in ("q", "dq", "wrench", "temperature")}
        yield log._replace(t=log.t[part] - log.t[part][0], **arrays)


def readings(drawn, log):
    """What each drawn simulator, which is our own model with its sensor, reads in the motion of a log."""
    for i, one in enumerate(drawn):
        of_robot = {name: x for name, x in one.effects.items() if name in OF_THE_ROBOT}
        truth, sensor = ft.simulate(replace(one, effects=of_robot), motion=log).truth, ft.sensor_model(one)
        memory = sensor.memory(float(np.diff(log.t).min()))
        yield np.asarray(read(sensor, log.t, truth.wrench_clean, truth.dq, jax.random.key(i), memory))


def judged(setup, first, second):
    """Tuned (where that is possible) and identified on one log, with the bias at its end; judged on another."""
    steps = []
    for name, step in STEPS.items():
        try:
            setup = step(setup, [first] if name == "tune" else first).setup
            steps.append(name)
        except ft.FtbiasError as error:
            steps.append(f"{name} refuses: {error.message}")
    diagnosis = ft.diagnose(setup, [first])
    share, width = covered(second, list(readings(draws_of(diagnosis, setup, 0), second)))
    return {
        "steps": steps,
        "verdict": diagnosis.verdict,
        "causes": [cause.title for cause in diagnosis.causes],
        "terms": [term.drive for term in diagnosis.terms],
        "covered": round(float(share), 3),
        "half_width": [float(f"{x:.2g}") for x in width],
    }


def main():
    real = folder()
    if real is None:
        print("skipped: no recorded logs: FTBIAS_SHARED names no folder with data/real")
        return
    setup, whole = abb(real)
    cases = {"ABB: second half after the first": (setup, *halves(setup, whole))}
    setup, first = panda(real, 1)
    cases["Panda: log 2 after log 1"] = (setup, first, panda(real, 2)[1])
    found = {}
    for name, case in cases.items():
        found[name] = judged(*case)
        print(name, found[name], flush=True)
    Path(__file__).with_suffix(".json").write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
