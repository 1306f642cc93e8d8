"""``ftbias demo``: a log with an effect that its setup lacks, filtered, diagnosed and corrected; needs no files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ftbias_jax.cli.given import start_jax
from ftbias_jax.errors import OutputError, UsageError
from ftbias_jax.io.atomic import make_folder
from ftbias_jax.io.log import Log
from ftbias_jax.io.write.outputs import check_outputs
from ftbias_jax.setup import Setup, dump_setup, load_setup, parse_setup
from ftbias_jax.types import AXES, AXIS_UNITS, Array

if TYPE_CHECKING:
    from ftbias_jax.diagnosis.result import Diagnosis
    from ftbias_jax.filtering.verbs.results import FilterResult
    from ftbias_jax.model.simulate_log import Truth

SETUP = {
    "robot": {"model": "panda"},
    "sensor": {"translation": [0.0, 0.0, 0.04], "noise_std": [0.1, 0.1, 0.1, 0.004, 0.004, 0.004]},
    "tool": {"mass": 0.9, "center_of_mass": [0.01, -0.005, 0.06], "inertia": [2.5e-3, 0.0, 0.0, 2.2e-3, 0.0, 1.1e-3]},
    "bias": {"noise_density": [2e-3, 1e-4], "initial_std": [5.0, 0.5], "initial_drift_std": [0.02, 1e-3]},
    "joints": {"position_noise_std": 2e-5, "velocity_noise_std": 1e-3},
}
FILES = (
    *("setup.toml", "log.npz", "before.npz", "report.html", "fixed.toml", "after.npz"),
    *("before.png", "after.png"),
)
"""The figures come last: they need matplotlib."""
TRUE_MASS = 0.97
"""kg: 70 g more than the setup states, as if the tool had been changed without a change of the setup."""
MOST_SAMPLES = 2_000_000
"""Maximum number of samples of the simulated log, which is held in memory several times."""
SETTLED = 1.0
"""s after the start from which the filter is evaluated; the tare for comparison is taken before."""


def run(arguments: argparse.Namespace) -> int:
    """Simulate, filter, diagnose, correct and filter again, printing each step and writing its files; returns 0."""
    folder, samples = Path(arguments.output), arguments.duration * arguments.rate
    if not 2 <= samples <= MOST_SAMPLES:
        remedy = f"ask for 2 to {MOST_SAMPLES} samples: seconds times rate"
        raise UsageError(f"{samples:.3g} samples are no demonstration", field="--duration", remedy=remedy)
    make_folder(folder)
    check_folder(folder)
    start_jax()
    from ftbias_jax.diagnosis.report.tables import parameter_words
    from ftbias_jax.model.simulate_log import simulate

    setup, hidden = parse_setup(SETUP, "setup.toml"), {"tool_mass": {"mass": TRUE_MASS}}
    made = simulate(setup, hidden, duration=arguments.duration, rate=arguments.rate, seed=arguments.seed)
    log, truth = made.log, made.truth
    setup.save(folder / "setup.toml")
    made.save(folder / "log.npz")
    recorded = f"{arguments.duration:g} s at {arguments.rate:g} Hz"
    noise = "{0:g} N, {3:g} Nm".format(*setup.sensor.noise_std)
    print(f"a simulated Panda, {recorded}, noise {noise}; its setup says that the tool weighs {setup.tool.mass} kg")

    before = _filter(setup, log, folder / "before.npz")
    print(f"1 filter    {_prediction(before)}")
    diagnosis = _diagnose(setup, log, folder)
    found = [f"{name} = {words}" for cause in diagnosis.causes for name, words in parameter_words(cause)]
    print("\n            ".join([f"2 diagnose  {diagnosis.sentence}", *found]))
    after = _filter(load_setup(folder / "fixed.toml"), log, folder / "after.npz")
    print(f"3 filter    {_prediction(after)}, with {folder / 'fixed.toml'}")
    print(f"the truth   mass = {TRUE_MASS} kg; the bias against its truth, after {SETTLED:g} s:")
    print(_against_truth(before, after, truth))
    names = list(FILES[:6])
    names += _draw(folder, {"before": before, "after": after}, truth.bias)
    print(f"wrote to {folder}: {' '.join(names)}")
    print(f"next: open {folder / 'report.html'}")
    return 0


def check_folder(folder: Path) -> None:
    """Refuse a folder in which the demonstration would overwrite foreign files, or two of its files are the same.

    Raises:
        OutputError: the folder has a log or a setup that is not from a demonstration.
        UsageError: links make two of the files the same.
    """
    check_outputs({name: folder / name for name in FILES}, ())
    ours = dump_setup(parse_setup(SETUP)).encode()
    setup, log = folder / "setup.toml", folder / "log.npz"
    there = setup.exists() or log.exists()
    if there and not (setup.is_file() and setup.read_bytes() == ours):
        message = "holds setup.toml or log.npz, which are not those of a demonstration"
        raise OutputError(message, file=folder, remedy="name a new folder")


def _filter(setup: Setup, log: Log, path: Path) -> FilterResult:
    from ftbias_jax.filtering.verbs.from_setup import filter_log

    result = filter_log(setup, log, unchecked=True)
    result.save(path)
    return result


def _diagnose(setup: Setup, log: Log, folder: Path) -> Diagnosis:
    """Diagnose the log, and write the report and the setup with the causes found."""
    from ftbias_jax.diagnosis.diagnose import diagnose

    diagnosis = diagnose(setup, [log], ["log.npz"])
    diagnosis.to_html(folder / "report.html", "Gap of log.npz with setup.toml")
    diagnosis.apply(setup).save(folder / "fixed.toml", by="diagnose --apply")
    return diagnosis


def _prediction(result: FilterResult) -> str:
    """Error of the reading predicted 1 s ahead; unlike a likelihood, larger noise parameters cannot improve it."""
    rms = result.summary.one_second_rms
    force, torque = (np.sqrt(np.mean(np.square(part))) for part in (rms[:3], rms[3:]))
    return f"error of the reading predicted 1 s ahead: {force:.3f} N, {torque:.4f} Nm"


def _against_truth(before: FilterResult, after: FilterResult, truth: Truth) -> str:
    """Table of errors against the simulated truth: filter before and after, and a tare from the first second."""
    from ftbias_jax.commissioning.result import aligned

    first = before.t - before.t[0] < SETTLED
    settled = ~first if not first.all() else first
    tare = (truth.wrench_tool - before.wrench_unbiased + before.bias)[first].mean(0)

    def rms(estimate: Array) -> Array:
        return np.sqrt(((estimate - truth.bias)[settled] ** 2).mean(0))

    def inside(filtered: FilterResult) -> Array:
        return (np.abs(filtered.bias - truth.bias) < 2 * filtered.bias_std)[settled].mean(0)

    rows = {
        "error before": rms(before.bias),
        "error after": rms(after.bias),
        "error of a 1 s tare": rms(tare),
        "inside 2 sigma before": inside(before),
        "inside 2 sigma after": inside(after),
    }
    head = ("", *(f"{axis} [{unit}]" for axis, unit in zip(AXES, AXIS_UNITS, strict=True)))
    return "\n".join(aligned([head, *((name, *(f"{x:.4f}" for x in row)) for name, row in rows.items())]))


def _draw(folder: Path, results: dict[str, FilterResult], bias: Array) -> list[str]:
    """Save a figure of each result, if matplotlib is installed; returns the names of the files."""
    from ftbias_jax.filtering.quality import plot

    names = []
    try:
        for name, filtered in results.items():
            figure = plot.plot_filtered(filtered, f"Simulated Panda, {name}: estimated and true bias", bias)
            plot.save_figure(str(folder / f"{name}.png"), figure)
            names.append(f"{name}.png")
    except OutputError as error:
        print(f"no figure: {error}")
    return names
