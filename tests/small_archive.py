"""A small archive of logs for the tests, filtered by the command in the current folder."""

import os
import tomllib
from pathlib import Path

import numpy as np

from ftbias_jax.cli.main import main
from ftbias_jax.fleet.manifest import read_lines
from ftbias_jax.io.write import npz

SETUP = """
[robot.flange]
translation = [0, 0, 1]
[[robot.joints]]
axis = [0, 0, 1]
point = [0, 0, 0]
[[robot.joints]]
axis = [0, 1, 0]
point = [0, 0, 0.5]
[sensor]
noise_std = [0.1, 0.004]
[tool]
mass = 0.7
center_of_mass = [0, 0, 0.06]
[joints]
process_noise_density = 5
"""


def named(setup=SETUP, names=("base", "elbow")):
    """The setup with the joint names of the tests' recordings."""
    for axis, name in zip(("axis = [0, 0, 1]", "axis = [0, 1, 0]"), names, strict=True):
        setup = setup.replace(axis, f'{axis}\nname = "{name}"')
    return setup


TABLES = {section: keys for section, keys in tomllib.loads(named()).items() if section != "joints"}
"""The same arm, with the usual noise of the joints."""


def write_log(path, seed=0, samples=300):
    rng = np.random.default_rng(seed)
    t = np.arange(samples) * 0.01
    q = np.sin(t[:, None] * [1.0, 1.3]) + 1e-5 * rng.normal(size=(samples, 2))
    up = np.stack([-np.sin(q[:, 1]), np.zeros(samples), np.cos(q[:, 1])], 1)  # of the base, in the sensor's frame
    weight = 0.7 * 9.81 * up
    path.parent.mkdir(parents=True, exist_ok=True)
    wrench = np.concatenate([weight, np.cross([0, 0, 0.06], weight)], 1) + rng.normal(size=(samples, 6))
    np.savez(path, t=t, q=q, wrench=wrench)


def filter_archive(*arguments):
    return main(["filter", *map(str, arguments), "--setup", "setup.toml", "-o", "out"])


def manifest(name="manifest.filter.jsonl"):
    """Last entry of every result in a manifest, in the order of their names."""
    entries = {line.output: line for line in read_lines(Path("out", name)) if hasattr(line, "output")}
    return [entries[output] for output in sorted(entries)]


def outputs():
    return {
        os.path.relpath(os.path.join(folder, name), "out"): npz.load_npz(os.path.join(folder, name))
        for folder, _, names in os.walk("out")
        for name in names
        if name.endswith(".npz")
    }


def assert_same_outputs(got, expected):
    assert got.keys() == expected.keys()
    for name, arrays in expected.items():
        for key, values in arrays.items():
            np.testing.assert_array_equal(got[name][key], values)
