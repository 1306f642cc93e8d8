"""``ftbias check``: whether a setup can be right, as far as logs show it."""

from __future__ import annotations

import argparse

from ftbias_jax.cli.repairs import tell_repairs
from ftbias_jax.filtering.check.check_setup import check_setup
from ftbias_jax.io import read_log
from ftbias_jax.io.outputs import check_outputs, check_writable
from ftbias_jax.setup import load_setup


def run(arguments: argparse.Namespace) -> int:
    """Print and write what is wrong; 1 if anything is, else 0."""
    if arguments.json:
        check_writable(arguments.json, ".json", "--json")
    setup = load_setup(arguments.setup)
    check_outputs({"--json": arguments.json}, (*arguments.logs, *setup.files))
    logs = [read_log(path, setup) for path in arguments.logs]
    check = check_setup(setup, logs)
    print(check)
    if arguments.json:
        check.to_json(arguments.json)
        print(f"wrote {arguments.json}")
    tell_repairs((path, log.repairs) for path, log in zip(arguments.logs, logs, strict=True))
    return 0 if check.ok else 1
