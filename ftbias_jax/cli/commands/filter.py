"""``ftbias filter``: logs in; bias, drift and corrected wrench out."""

from __future__ import annotations

import argparse
from pathlib import Path

from ftbias_jax.cli.jobs import filter_archive
from ftbias_jax.cli.jobs.filter_archive import with_choices
from ftbias_jax.cli.parsers.filtering import selection_of
from ftbias_jax.cli.repairs import tell_mistake, tell_repairs
from ftbias_jax.errors import UsageError
from ftbias_jax.filtering.quality.plot import figure_format, new_figure
from ftbias_jax.fleet.find import expand, inputs, is_folder
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.outputs import check_outputs, check_writable
from ftbias_jax.io.parts import open_log
from ftbias_jax.io.write import writer, written
from ftbias_jax.io.write.offsets import dump_offsets
from ftbias_jax.io.write.ours import EXPORT, FIGURE, RESULT
from ftbias_jax.io.write.provenance import in_words
from ftbias_jax.io.write.selection import check_selection
from ftbias_jax.runtime.progress import Stages
from ftbias_jax.setup import load_setup


def run(arguments: argparse.Namespace) -> int:
    """Filter a log into a file, or an archive into a folder; 3 if samples were lost or nothing was gained, else 0."""
    if is_folder(arguments.output):
        return filter_archive.run(arguments)
    writer(arguments.output)
    setup = with_choices(load_setup(arguments.setup, allow_outside=arguments.allow_outside), arguments)
    logs = expand(arguments.logs, setup.log.files)
    if len(logs) > 1:
        remedy = "give -o a folder's name, without a suffix"
        raise UsageError(f"{len(logs)} logs for the one file {arguments.output!r}", field="-o", remedy=remedy)
    (path,) = logs
    outputs = {"--output": arguments.output, "--plot": arguments.plot, "--offsets": arguments.offsets}
    outputs |= {f"the description {path!r}": path for path in written(arguments.output)[1:]}
    for option, output in outputs.items():
        if output:
            check_writable(output, option=option)
    if arguments.plot:
        figure_format(arguments.plot)
        new_figure()  # a missing package is told before minutes are spent
    kinds = {"--output": RESULT, "--plot": FIGURE, "--offsets": EXPORT}
    check_outputs(outputs, (*inputs(logs, setup.log.files), *setup.files), kinds, arguments.force)
    check_selection(selection_of(arguments), smooth=arguments.smooth, adapt=setup.bias.adapt)
    log = open_log(path, setup, salvage=arguments.salvage)

    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.cli.jobs.one_file import choices_of, filter_file
    from ftbias_jax.filtering.noise.log_noise import describe
    from ftbias_jax.filtering.quality import consistency, plot, spectrum
    from ftbias_jax.filtering.quality.summary import format_summary
    from ftbias_jax.filtering.verbs.results import format_joint_noise
    from ftbias_jax.model.own_effects import load_all

    setup = setup.with_effects(load_all(tuple(arguments.own_effects)))
    whole = bool(arguments.plot or arguments.check)
    choices = choices_of(arguments)
    with Stages(f"filtering {path}") as stages:
        stages("joints, noise and bias")
        outcome = filter_file(
            log,
            setup,
            arguments.output,
            choices,
            lambda share: stages(f"{share:.0%} filtered"),
            keep=whole,
            warn=lambda line: tell_mistake(path, line),
        )
    if arguments.plot:
        plot.save_figure(arguments.plot, plot.plot_filtered(outcome.filtered, Path(path).name))
    print(format_summary(outcome.summary))
    for line in describe(outcome.noise):
        print(line)
    print(format_joint_noise(outcome.params, setup.joints.model))
    if arguments.offsets:
        text = dump_offsets(outcome.summary.bias, setup.sensor.reports, remark=in_words(outcome.origin))
        write_atomic(arguments.offsets, lambda file: file.write(text.encode()))
        print(f"{arguments.offsets}: the bias at the end, as offsets that the broadcaster adds to each reading")
    print("wrote " + " and ".join(filter(None, (*written(arguments.output), arguments.plot, arguments.offsets))))
    if arguments.check:
        filtered = outcome.filtered
        checked = consistency.check(filtered.innovation, (filtered.innovation / filtered.innovation_std) ** 2)
        print(consistency.format_check(checked))
        lines = spectrum.find_lines(filtered.t, filtered.innovation)
        print(spectrum.format_lines(lines) if lines else "no hum or resonance in the innovations")
    code = tell_repairs([(path, outcome.repairs)])
    if outcome.worse and not outcome.warnings:
        tell_mistake(path, "the corrected wrench is worse than the raw one: ftbias check says why, or ftbias diagnose")
    return 3 if outcome.worse else code
