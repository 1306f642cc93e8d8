"""``ftbias check``: mistakes of sign, unit, frame or convention in a setup that logs show."""

import argparse
from collections.abc import Mapping
from typing import Any

from ftbias_jax.check.check_setup import check_setup
from ftbias_jax.cli.archive import Done, for_each_log
from ftbias_jax.cli.given import logs_of, setup_of, write_answers
from ftbias_jax.cli.terminal import print_repairs, warn
from ftbias_jax.filtering.quality.at_rest import rest_in_words
from ftbias_jax.fleet.entry import MISTAKES
from ftbias_jax.fleet.quality import of_check
from ftbias_jax.io import read_motion
from ftbias_jax.io.cleaning import slices
from ftbias_jax.io.log import Log
from ftbias_jax.io.write.outputs import CHECK
from ftbias_jax.io.write.provenance import provenance, source_of
from ftbias_jax.setup import Setup


def run(arguments: argparse.Namespace) -> int:
    """Print and write the mistakes found; returns 1 if there are any, 3 if logs of an archive failed, else 0."""
    setup = setup_of(arguments)
    if arguments.output:
        return for_each_log(arguments, setup, check_one, {}, ".check.json", single=("json",))
    paths = logs_of(arguments, setup, {"--json": CHECK})
    logs = [read_motion(path, setup) for path in paths]
    check = check_setup(setup, logs)
    print(check)
    write_answers(
        {arguments.json: lambda path: check.to_json(path, provenance(setup, list(map(source_of, logs, paths)), {}))}
    )
    for path, log in zip(paths, logs, strict=True):
        if check.ok and isinstance(log, Log) and (words := rest_in_words(setup, slices(log))):
            warn(f"{path}: {words}")
    print_repairs((path, log.repairs) for path, log in zip(paths, logs, strict=True))
    return 0 if check.ok else 1


def check_one(path: str, output: str, setup: Setup, asked: Mapping[str, Any]) -> Done:
    """Check the setup on one log of an archive."""
    log = read_motion(path, setup)
    check = check_setup(setup, [log])
    check.to_json(output)
    origin = provenance(setup, [source_of(log, path)], {})
    done = Done.of(log.repairs, origin["samples"], of_check(check, origin))
    if check.ok:
        return done
    return done._replace(status=MISTAKES, remarks=(*map(str, check.findings), *done.remarks))
