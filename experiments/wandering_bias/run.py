"""Filter error and diagnosis for a bias that wanders more than the setup states.

Each log is filtered with the stated and with the true noise density; errors are evaluated after its first tenth.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from random_setup import random_setup

import ftbias_jax as ft

TIMES, LOGS, SECONDS = (1, 5, 20, 60), 8, 60.0
SEED = 5100


def errors(setup, made):
    """Rms error of the bias in units of the sensor noise, and coverage of its 95 % intervals."""
    result = ft.filter_log(setup, made.log)
    error = (result.bias - made.truth.bias)[len(result.t) // 10 :]
    inside = np.abs(error) < 1.96 * result.bias_std[len(result.t) // 10 :]
    return np.sqrt(np.mean((error / setup.sensor.noise_std) ** 2)), inside.mean()


def one(times, seed):
    rng = np.random.default_rng(seed)
    stated = random_setup(rng)
    true = replace(stated, bias=replace(stated.bias, noise_density=times * stated.bias.noise_density))
    motion, rate = ("sines", "moves")[seed % 2], float(rng.choice([100, 200, 500]))
    made = ft.simulate(true, {}, duration=SECONDS, rate=rate, motion=motion, seed=seed)
    found = ft.diagnose(stated, made.log)
    names = [*(cause.effect for cause in found.causes), *(term.form for term in found.terms)]
    told = [np.array(x.section["noise_density"]) / true.bias.noise_density for x in found.terms if x.form == "wander"]
    return (*errors(stated, made), *errors(true, made), names, told)


def main():
    result = {}
    for times in TIMES:
        rows = [one(times, SEED + seed) for seed in range(LOGS)]
        error, inside, least, inside_least, names, density = zip(*rows, strict=True)
        told = [x for few in density for x in few]
        values = {
            "error of the bias, in noise of a sample, median": np.median(error),
            "the same, by the filter that knows the density": np.median(least),
            "in 95 % intervals": np.mean(inside),
            "in 95 % intervals, by the filter that knows": np.mean(inside_least),
            "told as a bias that wanders": sum(name == ["wander"] for name in names),
            "told as something else": sum(bool(name) and name != ["wander"] for name in names),
            "density told per true one, 5 to 95 %": np.quantile(told, [0.05, 0.95]) if told else [],
        }
        result[f"{times} times"] = {name: np.round(value, 4).tolist() for name, value in values.items()}
    print(json.dumps(result, indent=1))
    (Path(__file__).parent / "result.json").write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
