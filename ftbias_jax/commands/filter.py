"""``ftbias filter``: one log in; bias, drift and corrected wrench out."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ftbias_jax.errors import OutputError, UsageError
from ftbias_jax.logs import read_log_with_repairs
from ftbias_jax.plot import figure_format
from ftbias_jax.setup import load_setup
from ftbias_jax.writers import save_results, writer

if TYPE_CHECKING:
    from ftbias_jax.batch import Filtered, Summary
    from ftbias_jax.consistency import Consistency

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")


def run(arguments: argparse.Namespace) -> int:
    """Filter the log; returns 3 if samples were lost or an axis of the wrench was never measured, else 0."""
    writer(arguments.output)
    if Path(arguments.output).resolve() in (Path(arguments.log).resolve(), Path(arguments.setup).resolve()):
        raise UsageError(f"{arguments.output!r} is an input", field="--output", remedy="give the result its own name")
    check_folders(arguments.output, arguments.plot)
    setup = load_setup(arguments.setup)
    log, repairs = read_log_with_repairs(arguments.log, setup, salvage=arguments.salvage)

    from ftbias_jax.compilation import prepare_jax

    prepare_jax()
    from ftbias_jax import batch, consistency, plot
    from ftbias_jax.pipeline import Options, samples_from_log
    from ftbias_jax.progress import Progress

    options = Options(joint_model=setup.joints.model)
    likeliest = batch.likeliest_params(setup, samples_from_log(log), options)
    params = batch.guard_against_lag(likeliest)
    filtered = batch.filter_log(params, log, options, Progress(f"filtering {arguments.log}", len(log.t)))
    arrays = filtered._asdict()
    if arguments.smooth:
        mean, std = batch.smooth_log(likeliest, log, options)
        arrays |= {"bias_smooth": mean[:, 0], "drift_smooth": mean[:, 1]}
        arrays |= {"bias_smooth_std": std[:, 0], "drift_smooth_std": std[:, 1]}
    figure = plot.plot_filtered(filtered, Path(arguments.log).name) if arguments.plot else None
    save_results(arguments.output, arrays, log.start)
    if figure is not None:
        plot.save_figure(arguments.plot, figure)
    density = np.asarray(params.joint.process_density)
    print(format_summary(filtered, batch.summarise(filtered)))
    print(f"joint process noise ({setup.joints.model}): {' '.join(f'{x:.3g}' for x in density)}")
    print(f"wrote {arguments.output}" + (f" and {arguments.plot}" if arguments.plot else ""))
    if arguments.check:
        print(
            format_check(consistency.check(filtered.innovation, (filtered.innovation / filtered.innovation_std) ** 2))
        )
    for repair in repairs:
        print(f"ftbias: {arguments.log}: {repair.what}", file=sys.stderr)
    unmeasured = [name for name, axis in zip(AXES, np.isfinite(log.wrench).any(0), strict=True) if not axis]
    if unmeasured:
        print(f"ftbias: {arguments.log}: never measured: {' '.join(unmeasured)} (bias = prior)", file=sys.stderr)
    return 3 if unmeasured or any(repair.lost for repair in repairs) else 0


def check_outputs(output: str, suffix: str) -> None:
    """Refuse an output that cannot be written before minutes are spent on computing it."""
    if not output.endswith(suffix):
        raise UsageError(f"cannot write {output!r}", field="--output", remedy=f"end the name in {suffix}")
    check_folders(output, None)


def check_folders(output: str, plot: str | None) -> None:
    """Refuse folders that do not exist, and figures that cannot be drawn."""
    for path in filter(None, (output, plot)):
        if not Path(path).absolute().parent.is_dir():
            raise OutputError("the folder does not exist", file=path, remedy="create it, or name another")
    if plot:
        figure_format(plot)


def format_check(result: Consistency) -> str:
    """The consistency of the filter as a small table and a sentence."""
    from ftbias_jax.consistency import verdict

    rows = {
        "NIS (1 = right)": result.axis_nis,
        "correlation of neighbours": result.lag_one,
        "  95 % bound": result.lag_one_bound,
        "Ljung-Box / lags (1 = white)": result.ljung_box,
    }
    lines = [f"{name:28s}" + "".join(f"{x:11.3f}" for x in values) for name, values in rows.items()]
    return "\n".join(["consistency of the innovations:", *lines, verdict(result)])


def format_summary(filtered: Filtered, summary: Summary) -> str:
    """A table an engineer can read, one column an axis."""
    duration = filtered.t[-1] - filtered.t[0]
    rows = {
        "bias at the end": filtered.bias[-1],
        "  ± 1 sigma": filtered.bias_std[-1],
        "drift per minute": 60 * filtered.drift[-1],
        "  ± 1 sigma ": 60 * filtered.drift_std[-1],
        "raw reading, std": summary.raw_std,
        "corrected - tool model, std": summary.residual_std,
        "1 s ahead prediction, rms": summary.one_second_rms,
    }
    head = f"{len(filtered.t)} wrench samples, {duration:.1f} s\n{'':28s}" + "".join(
        f"{name + (' [N]' if i < 3 else ' [Nm]'):>11s}" for i, name in enumerate(AXES)
    )
    lines = [f"{name:28s}" + "".join(f"{x:11.4f}" for x in values) for name, values in rows.items()]
    nis = f"normalised innovation squared per axis: {summary.mean_nis:.2f} (1 = the stated model and noise are right)"
    return "\n".join([head, *lines, nis])
