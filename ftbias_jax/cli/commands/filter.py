"""``ftbias filter``: logs in; bias, drift and corrected wrench out."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ftbias_jax.cli.archive import Done, for_each_log
from ftbias_jax.cli.given import logs_of, only, setup_of, start_jax
from ftbias_jax.cli.terminal import print_repairs, warn
from ftbias_jax.filtering.quality.plot import figure_format, new_figure
from ftbias_jax.filtering.result import Filtered, named_arrays
from ftbias_jax.fleet.entry import LOSS
from ftbias_jax.fleet.find import is_folder
from ftbias_jax.fleet.quality import of_filter
from ftbias_jax.io.parts import OpenLog, open_log
from ftbias_jax.io.write import writer, written
from ftbias_jax.io.write.npz import save_npz_parts
from ftbias_jax.io.write.outputs import EXPORT, FIGURE, RESULT
from ftbias_jax.io.write.provenance import in_words
from ftbias_jax.io.write.selection import ALL, About, Selection, check_selection, selected_parts
from ftbias_jax.runtime.progress import Stages
from ftbias_jax.setup import Setup
from ftbias_jax.setup.export.ros import dump_offsets
from ftbias_jax.setup.save import write_text

if TYPE_CHECKING:
    from ftbias_jax.filtering.verbs.results import FilterResult


def run(arguments: argparse.Namespace) -> int:
    """Filter a log or an archive; returns 3 if samples were lost or the result is worse than the raw wrench, else 0."""
    many = is_folder(arguments.output)
    if not many:
        writer(arguments.output)
    setup = setup_of(arguments)
    bias = setup.bias if arguments.gate is None else replace(setup.bias, gate=arguments.gate)
    setup = replace(setup, bias=replace(bias, adapt=False) if arguments.as_stated else bias)
    selection = Selection(arguments.fields, arguments.precision, arguments.every, arguments.output_rate)
    check_selection(selection, smooth=arguments.smooth, adapt=setup.bias.adapt)
    if many:
        asked = {"smooth": arguments.smooth, "unchecked": arguments.unchecked, "salvage": arguments.salvage}
        asked |= selection._asdict() | {"fields": ",".join(arguments.fields)}
        single = ("plot", "check", "offsets")
        return for_each_log(arguments, setup, filter_one, asked, f".{arguments.format}", single=single)
    if arguments.plot:
        figure_format(arguments.plot)
        new_figure()  # reports a missing package before minutes are spent
    kinds = {"--output": RESULT, "--plot": FIGURE, "--offsets": EXPORT}
    beside = {f"the description {path!r}": path for path in written(arguments.output)[1:]}
    path = only(logs_of(arguments, setup, kinds, beside), f"the one file {arguments.output!r}")
    log = open_log(path, setup, salvage=arguments.salvage)
    start_jax()
    from ftbias_jax.filtering.quality import consistency, plot, spectrum
    from ftbias_jax.model.own_effects import load_all
    from ftbias_jax.runtime.kept_programs import compiled_for_few_calls

    setup = setup.with_effects(load_all(tuple(arguments.own_effects)))
    with Stages(f"filtering {path}") as stages, compiled_for_few_calls(log.length):
        stages("joints, noise and bias")
        result = filter_file(
            log,
            setup,
            arguments.output,
            selection,
            smooth=arguments.smooth,
            unchecked=arguments.unchecked,
            keep=bool(arguments.plot or arguments.check),
            progress=lambda samples: stages(f"{min(samples / log.length, 1):.0%} filtered"),
            warn=lambda line: warn(f"{path}: {line}"),
        )
    if arguments.plot:
        plot.save_figure(arguments.plot, plot.plot_filtered(result, Path(path).name))
    print(result.numbers())
    if arguments.offsets:
        origin = in_words(result.provenance) if result.provenance else ""
        text = dump_offsets(result.summary.bias, setup.sensor.reports, remark=origin)
        write_text(arguments.offsets, text)
        print(f"{arguments.offsets}: the bias at the end, as offsets that the broadcaster adds to each reading")
    print("wrote " + " and ".join(filter(None, (*written(arguments.output), arguments.plot, arguments.offsets))))
    if arguments.check:
        print(consistency.format_check(result.check()))
        lines = result.lines()
        print(spectrum.format_lines(lines) if lines else "no hum or resonance in the innovations")
    code = print_repairs([(path, result.repairs)])
    if result.worse_than_raw and result.checked.ok:
        warn(f"{path}: the corrected wrench is worse than the raw one: ftbias check says why, or ftbias diagnose")
    return 3 if result.worse_than_raw else code


def filter_one(path: str, output: str, setup: Setup, asked: Mapping[str, Any]) -> Done:
    """Filter one log of an archive."""
    log = open_log(path, setup, salvage=asked["salvage"])
    fields = tuple(filter(None, asked["fields"].split(",")))
    selection = Selection(fields, asked["precision"], asked["every"], asked["rate"])
    result = filter_file(log, setup, output, selection, smooth=asked["smooth"], unchecked=asked["unchecked"])
    done = Done.of(result.repairs, result.summary.samples, of_filter(result))
    status = LOSS if result.worse_than_raw else done.status
    return done._replace(status=status, remarks=(*result.checked.lines(), *done.remarks))


def filter_file(
    log: OpenLog,
    setup: Setup,
    output: str | os.PathLike[str],
    selection: Selection = ALL,
    *,
    smooth: bool = False,
    keep: bool = False,
    **further: Any,
) -> FilterResult:
    """Filter a log into a file, which is written completely or not at all.

    From NPZ to NPZ, a long log needs memory only for its stamps and a few chunks; in all other cases it is held whole.

    Args:
        log: log opened by ``open_log``.
        setup: setup of robot, sensor and tool.
        output: output file, whose suffix selects the format.
        selection: parts of the result that are written.
        smooth: also estimate the bias given past and future samples.
        keep: return all arrays; otherwise they may be those of the last chunk only.
        further: further arguments of ``filter_with_setup``.

    Raises:
        LogError: the log is damaged. SetupError: the tool is not stated although the log turns it. OutputError,
            UsageError: the result cannot be written.
    """
    from ftbias_jax.filtering.method.runs import alone
    from ftbias_jax.filtering.verbs.from_setup import filter_with_setup

    check_selection(selection, smooth=smooth, adapt=setup.bias.adapt)

    def write(parts: Iterator[Filtered], about: Callable[[], About]) -> None:
        chosen = selected_parts(map(named_arrays, parts), selection)
        save_npz_parts(output, chosen, lambda: about()._replace(selection=selection))

    whole = keep or smooth or not os.fspath(output).lower().endswith(".npz")
    result = alone(filter_with_setup(setup, log, smooth=smooth, write=None if whole else write, **further))
    if whole:
        result.save(output, **selection._asdict())
    return result
