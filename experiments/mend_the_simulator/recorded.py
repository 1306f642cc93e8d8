"""Coverage of the 95 % bands of simulators sampled from a diagnosis, on unseen episodes of recorded logs.

FTBIAS_SHARED=FOLDER python experiments/mend_the_simulator/recorded.py writes recorded.json beside this script.
"""

import json
import sys
from dataclasses import replace
from functools import partial
from itertools import permutations
from pathlib import Path

import jax
import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "real_logs"))
from cases import abb, folder, panda
from run import covered, draws_of, read

import ftbias_jax as ft
from ftbias_jax.filtering.method.ready import filtered_with
from ftbias_jax.simulators.mended import OF_THE_ROBOT

EPISODE = 8.0
"""s: length of an episode; the reading is tared over its first second, as is usual when a policy is trained."""


def halves(setup, log):
    """Yield the two halves of a log, each with stamps from 0 s."""
    cut = len(log.t) // 2
    for part in (slice(0, cut), slice(cut, None)):
        arrays = {name: getattr(log, name)[part] for name in ("q", "dq", "wrench", "temperature")}
        yield log._replace(t=log.t[part] - log.t[part][0], **arrays)


def readings(drawn, log, episodes):
    """Yield readings (E, L, 6) of each sampled simulator, the package's model with its sensor, in episodes of a log."""
    for i, one in enumerate(drawn):
        of_robot = {name: x for name, x in one.effects.items() if name in OF_THE_ROBOT}
        truth, sensor = ft.simulate(replace(one, effects=of_robot), motion=log).truth, ft.sensor_model(one)
        memory, keys = sensor.memory(float(np.diff(log.t).min())), jax.random.split(jax.random.key(i), len(episodes))
        inside = (np.stack([x[episode] for episode in episodes]) for x in (log.t, truth.wrench_clean, truth.dq))
        read_all = jax.vmap(partial(read, memory=memory), (None, 0, 0, 0, 0))
        yield sensor.sign * np.asarray(read_all(sensor, *inside, keys))


def judged(setup, first, second):
    """Identify tool, bias and noise on one log and diagnose it, then score the sampled simulators on another log."""
    setup = ft.identify_tool(setup, first, bias=True).setup
    setup = ft.setup_with(setup, filtered_with(setup, first)[1])
    diagnosis = ft.diagnose(setup, [first])
    starts = np.searchsorted(second.t, np.arange(0, second.t[-1] - EPISODE, EPISODE))
    length = int(EPISODE / np.median(np.diff(second.t)))
    episodes = [slice(start, start + length) for start in starts if start + length <= len(second.t)]
    simulated = np.stack(list(readings(draws_of(diagnosis, setup, 0), second, episodes)), 1)
    parts = [second._replace(t=second.t[x] - second.t[x][0], wrench=second.wrench[x]) for x in episodes]
    shares, widths = zip(*(covered(*pair) for pair in zip(parts, simulated, strict=True)), strict=True)
    return {
        "episodes": len(episodes),
        "verdict": diagnosis.verdict,
        "causes": [cause.title for cause in diagnosis.causes],
        "terms": [term.drive for term in diagnosis.terms],
        "covered": round(float(np.mean(shares)), 3),
        "half_width": [float(f"{x:.2g}") for x in np.mean(widths, axis=0)],
    }


def main():
    real = folder()
    if real is None:
        print("skipped: no recorded logs: FTBIAS_SHARED names no folder with data/real")
        return
    setup, whole = abb(real)
    cases = {"ABB: second half after the first": (setup, *halves(setup, whole))}
    for one, other in permutations((1, 2, 3), 2):
        setup, first = panda(real, one)
        cases[f"Panda: log {other} after log {one}"] = (setup, first, panda(real, other)[1])
    found = {}
    for name, case in cases.items():
        found[name] = judged(*case)
        print(name, found[name], flush=True)
    Path(__file__).with_suffix(".json").write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
