"""``ftbias demo``: simulate, filter, compare with the truth; needs no files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ftbias_jax.atomic import write_atomic
from ftbias_jax.errors import OutputError, UsageError
from ftbias_jax.setup import parse_setup
from ftbias_jax.types import Array

if TYPE_CHECKING:
    from ftbias_jax.batch import Filtered

SETUP = {
    "robot": {"model": "panda"},
    "sensor": {"translation": [0.0, 0.0, 0.04], "noise_std": [0.1, 0.1, 0.1, 0.004, 0.004, 0.004]},
    "tool": {
        "mass": 0.9,
        "center_of_mass": [0.01, -0.005, 0.06],
        "inertia": [2.5e-3, 0.0, 0.0, 2.2e-3, 0.0, 1.1e-3],
    },
    "bias": {"noise_density": [2e-3, 1e-4], "initial_std": [5.0, 0.5], "initial_drift_std": [0.02, 1e-3]},
    "joints": {"position_noise_std": 2e-5, "velocity_noise_std": 1e-3},
}
CENTER = (0.0, -0.6, 0.0, -2.0, 0.0, 1.8, 0.8)
EXCURSION = (0.8, 0.5, 0.8, 0.5, 1.2, 1.0, 1.5)


def run(arguments: argparse.Namespace) -> int:
    """Write the demonstration's log, result and figure into a folder."""
    folder, count = Path(arguments.output), round(arguments.duration * arguments.rate)
    if count < 2:
        raise UsageError(f"{count} samples are no log", field="--duration", remedy="ask for more seconds")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make the folder: {error.strerror}", file=folder, remedy="name another") from error

    import jax

    from ftbias_jax.compilation import prepare_jax

    prepare_jax()
    import jax.numpy as jnp

    from ftbias_jax import batch, plot, results, simulate
    from ftbias_jax.commands.filter import format_summary
    from ftbias_jax.pipeline import params_from_setup, samples_from_log
    from ftbias_jax.progress import Progress
    from ftbias_jax.setup import dump_setup
    from ftbias_jax.summary import summarise
    from ftbias_jax.types import Log

    setup = parse_setup(SETUP, "the demonstration's setup")
    motion_key, log_key = jax.random.split(jax.random.key(arguments.seed))
    t = jnp.arange(count) / arguments.rate
    trajectory = simulate.excitation_sines(motion_key, t, jnp.array(CENTER), jnp.array(EXCURSION))
    truth = simulate.simulate(log_key, params_from_setup(setup), trajectory)
    t, q, dq, wrench = jax.tree.map(np.asarray, (t, truth.q, truth.dq, truth.wrench))
    log = Log(t, q, dq, wrench, np.full(len(t), np.nan))
    write_atomic(folder / "setup.toml", lambda file: file.write(dump_setup(setup).encode()))
    results.save_npz(folder / "log.npz", {"t": log.t, "q": log.q, "dq": log.dq, "wrench": log.wrench})

    params = batch.params_for_log(setup, samples_from_log(log))
    filtered = batch.filter_log(params, log, progress=Progress("filtering", len(t)))
    results.save_npz(folder / "result.npz", filtered._asdict())
    print(f"A simulated Panda with a {setup.tool.mass} kg tool, {arguments.duration:g} s at {arguments.rate:g} Hz")
    print(format_summary(summarise(filtered)))
    print(_against_truth(filtered, np.asarray(truth.bias), np.asarray(truth.wrench_tool)))
    written = [folder / name for name in ("setup.toml", "log.npz", "result.npz")]
    try:
        figure = plot.plot_filtered(filtered, "Simulated Panda: estimated and true bias", np.asarray(truth.bias))
        plot.save_figure(str(folder / "bias.png"), figure)
        written.append(folder / "bias.png")
    except OutputError as error:
        print(f"no figure: {error}")
    print("wrote " + ", ".join(str(path) for path in written))
    return 0


def _against_truth(filtered: Filtered, bias: Array, wrench_tool: Array) -> str:
    """Errors against the simulated truth: the filter, and a tare that trusts the first second for ever."""
    first = filtered.t - filtered.t[0] < 1.0
    tare = (wrench_tool - filtered.wrench_unbiased + filtered.bias)[first].mean(0)
    settled = filtered.t - filtered.t[0] > 1.0
    if not settled.any():
        settled = slice(None)
    error = filtered.bias - bias
    inside = np.abs(error[settled]) < 2 * filtered.bias_std[settled]
    rows = {
        "error of the bias, rms": np.sqrt((error[settled] ** 2).mean(0)),
        "  the same of a 1 s tare": np.sqrt(((tare - bias)[settled] ** 2).mean(0)),
        "inside the 2 sigma band": inside.mean(0),
    }
    lines = [f"{name:28s}" + "".join(f"{x:11.4f}" for x in values) for name, values in rows.items()]
    return "\n".join(["against the truth, after 1 s:", *lines])
