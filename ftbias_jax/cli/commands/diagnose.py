"""``ftbias diagnose``: where logs depart from the model, which effects cause it, and how far the gap shrinks."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ftbias_jax.cli.repairs import tell_repairs
from ftbias_jax.errors import UsageError
from ftbias_jax.io import read_log
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.outputs import check_outputs, check_writable, output_of_setup
from ftbias_jax.setup import Setup, dump_setup, load_setup

if TYPE_CHECKING:
    from ftbias_jax.diagnosis.result import Candidate, Diagnosis


def run(arguments: argparse.Namespace) -> int:
    """Diagnose the logs; returns 3 if samples of a log were lost, else 0."""
    setup = check_arguments(arguments)
    if setup.pose is not None:
        raise UsageError("needs the joints of an arm", file=arguments.setup, field="sensor_pose", remedy="use filter")
    logs = [read_log(path, setup, raw=True) for path in arguments.logs]

    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.diagnosis.diagnose import diagnose
    from ftbias_jax.diagnosis.report.tables import to_table

    check_effects(arguments.without)
    names = [Path(path).name for path in arguments.logs]
    diagnosis = diagnose(setup, logs, names, without=tuple(arguments.without))
    print(to_table(diagnosis))
    outputs = make_outputs(arguments, setup, diagnosis)
    for path, text in outputs.items():
        _write(path, text)
    if outputs:
        print(f"wrote {', '.join(outputs)}")
    return tell_repairs(zip(arguments.logs, diagnosis.repairs, strict=True))


def check_arguments(arguments: argparse.Namespace) -> Setup:
    """The setup; what cannot be written is refused before minutes are spent on computing it.

    Raises:
        UsageError: a suffix that does not fit, --apply without --output or the other way round, an output that is an
            input or another output. OutputError: a folder that does not exist. SetupError: a wrong setup.
    """
    if arguments.apply and not arguments.output and not arguments.in_place:
        remedy = "add -o FIXED.toml, or --in-place to replace the setup itself"
        raise UsageError("needs the name of the setup to write", field="--apply", remedy=remedy)
    if arguments.output and not arguments.apply:
        raise UsageError("is the setup that --apply writes", field="--output", remedy="add --apply")
    if arguments.in_place and not arguments.apply:
        raise UsageError("replaces the setup by what --apply writes", field="--in-place", remedy="add --apply")
    kept = [arguments.setup]
    if arguments.apply:
        arguments.output, kept = output_of_setup(arguments.output, arguments.setup, arguments.in_place)
    named = {"--json": (arguments.json, ".json"), "--html": (arguments.html, ".html")}
    for option, (path, suffix) in named.items():
        if path is not None:
            check_writable(path, suffix, option)
    setup = load_setup(arguments.setup)
    outputs = {"--output": arguments.output, **{option: path for option, (path, _) in named.items()}}
    check_outputs(outputs, (*arguments.logs, *kept, setup.urdf))
    return setup


def check_effects(names: Sequence[str]) -> None:
    """Refuse names that are not in the catalogue.

    Raises:
        UsageError: an unknown effect.
    """
    from ftbias_jax.model.effects.catalogue import CATALOGUE
    from ftbias_jax.setup.fields import nearest

    for name in names:
        if name not in CATALOGUE:
            raise UsageError(f"unknown effect {name!r}", field="--without", remedy=nearest(name, CATALOGUE))


def make_outputs(arguments: argparse.Namespace, setup: Setup, diagnosis: Diagnosis) -> Mapping[str, str]:
    """Path -> content of the files that the command line asks for."""
    from ftbias_jax.diagnosis.report.html import to_html
    from ftbias_jax.diagnosis.report.tables import to_json

    outputs = {}
    if arguments.json:
        outputs[arguments.json] = json.dumps(to_json(diagnosis), indent=1, allow_nan=False) + "\n"
    if arguments.html:
        title = f"Gap of {', '.join(diagnosis.logs)} with {Path(arguments.setup).name}"
        outputs[arguments.html] = to_html(diagnosis, title)
    if arguments.apply:
        outputs[arguments.output] = fixed_setup(setup, diagnosis.causes)
    return outputs


def fixed_setup(setup: Setup, causes: Sequence[Candidate]) -> str:
    """The setup as TOML text with the causes among its effects; the same setup if there are none.

    Args:
        setup: of the diagnosis.
        causes: their values replace those the setup has for the same effect.
    """
    from ftbias_jax.diagnosis.report.tables import parameter_words
    from ftbias_jax.model.effects.catalogue import values_from_setup

    effects = {**setup.effects, **{cause.effect: cause.parameters for cause in causes}}
    values_from_setup(effects)  # what is written can be read
    comments = {
        f"effects.{cause.effect}.{name}": f"ftbias diagnose: {words}"
        for cause in causes
        for name, words in parameter_words(cause)
    }
    return dump_setup(replace(setup, effects=effects), comments)


def _write(path: str, text: str) -> None:
    write_atomic(path, lambda file: file.write(text.encode()))
