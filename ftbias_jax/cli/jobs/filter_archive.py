"""``ftbias filter`` into a folder: an archive of logs, resumable, by several processes or machines."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial

from ftbias_jax.cli.jobs.many import find_tasks, refuse_options, run_archive
from ftbias_jax.cli.parsers.filtering import selection_of
from ftbias_jax.fleet.entry import settings_of
from ftbias_jax.io.write.selection import check_selection
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.types import Setup


def run(arguments: argparse.Namespace) -> int:
    """Filter what is not done; 3 if logs failed or lost samples, 1 if all failed, else 0."""
    refuse_options(arguments, ("plot", "check", "offsets"))
    setup = with_choices(load_setup(arguments.setup, allow_outside=arguments.allow_outside), arguments)
    check_selection(selection_of(arguments), smooth=arguments.smooth, adapt=setup.bias.adapt)
    tasks, manifest = find_tasks(arguments, setup, "filter", f".{arguments.format}")

    from ftbias_jax.cli.jobs.one_file import choices_of
    from ftbias_jax.cli.jobs.work import filter_one

    choices, own = choices_of(arguments), tuple(arguments.own_effects)
    settings = settings_of("filter", setup, {**choices._asdict(), "salvage": arguments.salvage}, own)
    work = partial(filter_one, setup=setup, choices=choices, salvage=arguments.salvage, own=own)
    return run_archive(arguments, settings, tasks, manifest, work)


def with_choices(setup: Setup, arguments: argparse.Namespace) -> Setup:
    """The setup with what the command line says about the gate and about adapting to the log."""
    bias = setup.bias
    if arguments.gate is not None:
        bias = replace(bias, gate=arguments.gate)
    if arguments.as_stated:
        bias = replace(bias, adapt=False)
    return replace(setup, bias=bias)
