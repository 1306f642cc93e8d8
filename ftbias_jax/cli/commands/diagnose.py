"""``ftbias diagnose``: where logs depart from the model, which effects cause it, and how far the gap shrinks."""

from __future__ import annotations

import argparse
import shlex
import sys
from functools import partial
from pathlib import Path

from ftbias_jax.cli.repairs import tell_repairs
from ftbias_jax.errors import UsageError
from ftbias_jax.fleet.find import expand, inputs, is_folder
from ftbias_jax.io import read_log
from ftbias_jax.io.outputs import behind_link, check_outputs, check_writable, output_of_setup
from ftbias_jax.io.write.ours import DIAGNOSIS, PAGE, SETUP
from ftbias_jax.setup import Setup, load_setup


def run(arguments: argparse.Namespace) -> int:
    """Diagnose the logs; 1 if a cause cannot be applied, 3 if samples of a log were lost, else 0."""
    if arguments.output and is_folder(arguments.output):
        return _each(arguments)
    setup = check_arguments(arguments)

    from ftbias_jax.runtime.imports import many_imports
    from ftbias_jax.runtime.progress import Stages

    names = [Path(path).name for path in arguments.logs]
    with Stages(f"diagnosing {', '.join(names)}") as stages:
        stages("reading")
        logs = [read_log(path, setup, raw=True) for path in arguments.logs]
        with many_imports():
            from ftbias_jax.runtime.jax_config import prepare_jax

            prepare_jax()
            from ftbias_jax.diagnosis.apply import refused, some_applied
            from ftbias_jax.diagnosis.diagnose import diagnose
            from ftbias_jax.model.effects.catalogue import check_names
            from ftbias_jax.model.own_effects import catalogue_of_setup, load_all

        setup = setup.with_effects(load_all(tuple(arguments.own_effects)))
        check_names(arguments.without, "--without", catalogue_of_setup(setup))
        without, unchecked = tuple(arguments.without), arguments.unchecked
        diagnosis = diagnose(setup, logs, names, without=without, unchecked=unchecked, progress=stages)
    command = shlex.join(("ftbias", "diagnose", *arguments.logs, "--setup", arguments.setup))
    diagnosis = diagnosis._replace(command=command)
    print(diagnosis)
    if arguments.json:
        diagnosis.to_json(arguments.json)
    if arguments.html:
        diagnosis.to_html(arguments.html)
    not_stated = refused(setup, diagnosis.causes, diagnosis.terms) if arguments.apply else ()
    applied = arguments.apply and some_applied(diagnosis, not_stated)
    if applied:
        place, by = behind_link(arguments.output, arguments.in_place), "" if arguments.in_place else "diagnose --apply"
        diagnosis.apply(setup).save(place, by=by)
    outputs = [path for path in (arguments.json, arguments.html, applied and arguments.output) if path]
    if outputs:
        print(f"wrote {', '.join(outputs)}")
    for why in not_stated:
        print(f"ftbias: not applied: {why}", file=sys.stderr)
    code = tell_repairs(zip(arguments.logs, diagnosis.repairs, strict=True))
    return 1 if not_stated else code


def _each(arguments: argparse.Namespace) -> int:
    """Every log by itself, into a folder."""
    from ftbias_jax.cli.jobs.many import ANSWER, APPLIED, REPORT, find_tasks, refuse_options, run_archive
    from ftbias_jax.fleet.entry import settings_of

    refuse_options(arguments, ("json", "html", "in_place"))
    setup = load_setup(arguments.setup, allow_outside=arguments.allow_outside)
    tasks, manifest = find_tasks(
        arguments, setup, "diagnose", ANSWER, (REPORT, APPLIED) if arguments.apply else (REPORT,)
    )

    from ftbias_jax.cli.jobs.work import diagnose_one
    from ftbias_jax.model.effects.catalogue import check_names
    from ftbias_jax.model.own_effects import catalogue_of_setup, load_all

    own, without = tuple(arguments.own_effects), tuple(sorted(arguments.without))
    check_names(without, "--without", catalogue_of_setup(setup.with_effects(load_all(own))))
    asked = {"without": without, "unchecked": arguments.unchecked} | ({"apply": True} if arguments.apply else {})
    settings = settings_of("diagnose", setup, {**asked, "without": list(without)}, own)
    work = partial(diagnose_one, setup=setup, **asked, own=own)
    return run_archive(arguments, settings, tasks, manifest, work)


def check_arguments(arguments: argparse.Namespace) -> Setup:
    """The setup, and the logs in ``arguments``; what cannot be written is refused before minutes are spent.

    Raises:
        UsageError: a suffix that does not fit, --apply without --output or the other way round, an output that is an
            input or another output. OutputError: a folder that does not exist. SetupError: a wrong setup.
    """
    if arguments.apply and not arguments.output and not arguments.in_place:
        remedy = "add -o FIXED.toml, or --in-place to replace the setup itself"
        raise UsageError("needs the name of the setup to write", field="--apply", remedy=remedy)
    if arguments.output and not arguments.apply:
        remedy = "add --apply; the diagnosis itself is written by --json OUT.json and --html OUT.html"
        raise UsageError("is the setup that --apply writes", field="--output", remedy=remedy)
    if arguments.in_place and not arguments.apply:
        raise UsageError("replaces the setup by what --apply writes", field="--in-place", remedy="add --apply")
    kept = [arguments.setup]
    if arguments.apply:
        arguments.output, kept = output_of_setup(arguments.output, arguments.setup, arguments.in_place)
    named = {"--json": (arguments.json, ".json"), "--html": (arguments.html, ".html")}
    for option, (path, suffix) in named.items():
        if path is not None:
            check_writable(path, suffix, option)
    setup = load_setup(arguments.setup, allow_outside=arguments.allow_outside)
    arguments.logs = expand(arguments.logs, setup.log.files)
    outputs = {"--output": arguments.output, **{option: path for option, (path, _) in named.items()}}
    kinds = {"--json": DIAGNOSIS, "--html": PAGE} | ({} if arguments.in_place else {"--output": SETUP})
    check_outputs(outputs, (*inputs(arguments.logs, setup.log.files), *kept, setup.urdf), kinds, arguments.force)
    return setup
