"""``ftbias filter``: logs in; bias, drift and corrected wrench out."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ftbias_jax.cli.commands import filter_archive
from ftbias_jax.cli.commands.filter_archive import with_gate
from ftbias_jax.cli.repairs import tell_repairs
from ftbias_jax.errors import UsageError
from ftbias_jax.filtering.quality.plot import figure_format, new_figure
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.outputs import check_outputs, check_writable
from ftbias_jax.io.parts import open_log
from ftbias_jax.io.write import writer
from ftbias_jax.io.write.offsets import dump_offsets
from ftbias_jax.runtime.progress import Progress
from ftbias_jax.setup import load_setup
from ftbias_jax.types import AXES

if TYPE_CHECKING:
    from ftbias_jax.filtering.quality.consistency import Consistency
    from ftbias_jax.filtering.quality.summary import Summary


def run(arguments: argparse.Namespace) -> int:
    """Filter a log into a file, or an archive into a folder; 3 if samples or logs were lost, else 0."""
    if _is_folder(arguments.output):
        return filter_archive.run(arguments)
    writer(arguments.output)
    if len(arguments.logs) > 1:
        remedy = "give -o a folder's name, without a suffix"
        raise UsageError(f"{len(arguments.logs)} logs for the one file {arguments.output!r}", field="-o", remedy=remedy)
    (path,) = arguments.logs
    outputs = {"--output": arguments.output, "--plot": arguments.plot, "--offsets": arguments.offsets}
    for option, output in outputs.items():
        if output:
            check_writable(output, option=option)
    if arguments.plot:
        figure_format(arguments.plot)
        new_figure()  # a missing package is told before minutes are spent
    setup = with_gate(load_setup(arguments.setup), arguments.gate)
    check_outputs(outputs, (path, *setup.files))
    log = open_log(path, setup, salvage=arguments.salvage)

    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.cli.jobs.one_file import Choices, filter_file
    from ftbias_jax.filtering.quality import consistency, plot

    whole = bool(arguments.plot or arguments.check)
    progress = Progress(f"filtering {path}", 1.0)
    outcome = filter_file(log, setup, arguments.output, Choices(arguments.smooth), progress, keep=whole)
    if arguments.plot:
        plot.save_figure(arguments.plot, plot.plot_filtered(outcome.filtered, Path(path).name))
    print(format_summary(outcome.summary))
    density = np.asarray(outcome.params.joint.process_density)
    print(f"joint process noise ({setup.joints.model}): {' '.join(f'{x:.3g}' for x in density)}")
    if arguments.offsets:
        text = dump_offsets(outcome.summary.bias, setup.sensor.reports)
        write_atomic(arguments.offsets, lambda file: file.write(text.encode()))
        print(f"{arguments.offsets}: the bias at the end, as offsets that the broadcaster adds to each reading")
    print("wrote " + " and ".join(filter(None, (arguments.output, arguments.plot, arguments.offsets))))
    if arguments.check:
        innovation = outcome.filtered.innovation
        print(format_check(consistency.check(innovation, (innovation / outcome.filtered.innovation_std) ** 2)))
    return tell_repairs([(path, outcome.repairs)])


def _is_folder(output: str) -> bool:
    """Whether an output is meant to be a folder: it is one, or has no suffix."""
    return output.endswith(("/", os.sep)) or Path(output).is_dir() or not Path(output).suffix


def format_check(result: Consistency) -> str:
    """The consistency of the filter as a small table and a sentence."""
    from ftbias_jax.filtering.quality.consistency import verdict

    rows = {
        "NIS (1 = right)": result.axis_nis,
        "correlation of neighbours": result.lag_one,
        "  95 % bound": result.lag_one_bound,
        "Ljung-Box / lags (1 = white)": result.ljung_box,
    }
    lines = [f"{name:28s}" + "".join(f"{x:11.3f}" for x in values) for name, values in rows.items()]
    return "\n".join(["consistency of the innovations:", *lines, verdict(result)])


def format_summary(summary: Summary) -> str:
    """A table an engineer can read, one column an axis."""
    rows = {
        "bias at the end": summary.bias,
        "  ± 1 sigma": summary.bias_std,
        "drift per minute": 60 * summary.drift,
        "  ± 1 sigma ": 60 * summary.drift_std,
        "raw reading, std": summary.raw_std,
        "corrected - tool model, std": summary.residual_std,
        "1 s ahead prediction, rms": summary.one_second_rms,
    }
    head = f"{summary.samples} wrench samples, {summary.seconds:.1f} s\n{'':28s}" + "".join(
        f"{name + (' [N]' if i < 3 else ' [Nm]'):>11s}" for i, name in enumerate(AXES)
    )
    lines = [f"{name:28s}" + "".join(f"{x:11.4f}" for x in values) for name, values in rows.items()]
    nis = f"normalised innovation squared per axis: {summary.mean_nis:.2f} (1 = the stated model and noise are right)"
    return "\n".join([head, *lines, nis, *_gate_lines(summary)])


def _gate_lines(summary: Summary) -> list[str]:
    """What the gate did, or could do. Where very many samples are off, the model may be wrong, which no gate mends."""
    if summary.gated:
        return [f"{summary.gated} samples ({summary.gated / summary.samples:.2%}) did not pass the gate: contact?"]
    if summary.far:
        line = f"{summary.far} samples are far off their prediction: contact? --gate 5 keeps them out of the bias"
        return [line + ("; or a wrong setup? ftbias diagnose" if summary.far > summary.samples / 4 else "")]
    return []
