"""``ftbias check``: whether a setup can be right, as far as logs show it."""

from __future__ import annotations

import argparse
from functools import partial

from ftbias_jax.check.check_setup import check_setup
from ftbias_jax.cli.jobs.many import find_tasks, refuse_options, run_archive
from ftbias_jax.cli.repairs import tell_mistake, tell_repairs
from ftbias_jax.filtering.quality.at_rest import rest_in_words
from ftbias_jax.fleet.entry import settings_of
from ftbias_jax.fleet.find import expand, inputs
from ftbias_jax.io import read_motion
from ftbias_jax.io.cleaning import slices
from ftbias_jax.io.log import Log
from ftbias_jax.io.outputs import check_outputs, check_writable
from ftbias_jax.io.write.ours import CHECK
from ftbias_jax.io.write.provenance import provenance, source_of
from ftbias_jax.setup import load_setup


def run(arguments: argparse.Namespace) -> int:
    """Print and write what is wrong; 1 if anything is, else 0; 3 if logs of an archive could not be checked."""
    if arguments.output:
        return _each(arguments)
    if arguments.json:
        check_writable(arguments.json, ".json", "--json")
    setup = load_setup(arguments.setup, allow_outside=arguments.allow_outside)
    paths = expand(arguments.logs, setup.log.files)
    kinds = {"--json": CHECK}
    check_outputs({"--json": arguments.json}, (*inputs(paths, setup.log.files), *setup.files), kinds, arguments.force)
    logs = [read_motion(path, setup) for path in paths]
    check = check_setup(setup, logs)
    print(check)
    if arguments.json:
        check.to_json(arguments.json, provenance(setup, list(map(source_of, logs, paths)), {}))
        print(f"wrote {arguments.json}")
    for path, log in zip(paths, logs, strict=True):
        if check.ok and isinstance(log, Log) and (words := rest_in_words(setup, slices(log))):
            tell_mistake(path, words)
    tell_repairs((path, log.repairs) for path, log in zip(paths, logs, strict=True))
    return 0 if check.ok else 1


def _each(arguments: argparse.Namespace) -> int:
    """Every log by itself, into a folder."""
    refuse_options(arguments, ("json",))
    setup = load_setup(arguments.setup, allow_outside=arguments.allow_outside)
    tasks, manifest = find_tasks(arguments, setup, "check", ".check.json")

    from ftbias_jax.cli.jobs.work import check_one

    settings = settings_of("check", setup, {})
    return run_archive(arguments, settings, tasks, manifest, partial(check_one, setup=setup))
