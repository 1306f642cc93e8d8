"""``ftbias diagnose``: where logs depart from the model, which effects cause it, and how far the gap shrinks."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ftbias_jax.cli.commands.filter import check_outputs
from ftbias_jax.errors import UsageError
from ftbias_jax.io import read_log
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.sensor_pose import require_arm
from ftbias_jax.types import AXES, Log


def run(arguments: argparse.Namespace) -> int:
    """Diagnose the logs; returns 3 if an axis of a wrench was never measured, else 0."""
    check_arguments(arguments)
    setup = load_setup(arguments.setup)
    require_arm(setup)
    logs = [read_log(path, setup) for path in arguments.logs]

    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.diagnosis.diagnose import diagnose
    from ftbias_jax.model.effects.catalogue import check_names

    check_names(arguments.without, "--without")
    names = [Path(path).name for path in arguments.logs]
    diagnosis = diagnose(setup, logs, names, without=tuple(arguments.without))
    print(diagnosis)
    if arguments.json:
        diagnosis.to_json(arguments.json)
    if arguments.html:
        diagnosis.to_html(arguments.html)
    if arguments.apply:
        diagnosis.apply(setup).save(arguments.output)
    outputs = [path for path in (arguments.json, arguments.html, arguments.output) if path]
    if outputs:
        print(f"wrote {', '.join(outputs)}")
    return _report_unmeasured(arguments.logs, logs)


def check_arguments(arguments: argparse.Namespace) -> None:
    """Refuse what cannot be written before minutes are spent on computing it.

    Raises:
        UsageError: a suffix that does not fit, --apply without --output or the other way round, one name twice.
        OutputError: a folder that does not exist.
    """
    if arguments.apply and not arguments.output:
        raise UsageError("needs the name of the setup to write", field="--apply", remedy="add -o FIXED.toml")
    if arguments.output and not arguments.apply:
        raise UsageError("is the setup that --apply writes", field="--output", remedy="add --apply")
    named = {"--json": (arguments.json, ".json"), "--html": (arguments.html, ".html")}
    for option, (path, suffix) in named.items():
        if path is not None and not path.endswith(suffix):
            raise UsageError(f"cannot write {path!r}", field=option, remedy=f"end the name in {suffix}")
    if arguments.output:
        check_outputs(arguments.output, ".toml")
    for path, suffix in named.values():
        if path is not None:
            check_outputs(path, suffix)


def _report_unmeasured(paths: Sequence[str], logs: Sequence[Log]) -> int:
    """Exit code, and a line on standard error for each log that lacks an axis of the wrench."""
    code = 0
    for path, log in zip(paths, logs, strict=True):
        unmeasured = [name for name, axis in zip(AXES, np.isfinite(log.wrench).any(0), strict=True) if not axis]
        if unmeasured:
            print(f"ftbias: {path}: never measured: {' '.join(unmeasured)}", file=sys.stderr)
            code = 3
    return code
