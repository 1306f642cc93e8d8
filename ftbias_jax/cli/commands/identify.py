"""``ftbias identify``: the tool's inertial parameters from a log."""

from __future__ import annotations

import argparse
import sys

from ftbias_jax.cli.commands.filter import check_outputs
from ftbias_jax.io import read_log
from ftbias_jax.setup import load_setup


def run(arguments: argparse.Namespace) -> int:
    """Identify the tool and write a setup that has it; 1 if the search did not converge, else 0."""
    check_outputs(arguments.output, ".toml")
    setup = load_setup(arguments.setup)
    log = read_log(arguments.log, setup)

    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.calibration.identify_tool import identify_tool

    found = identify_tool(setup, log, mounting=arguments.mounting, gravity=arguments.gravity)
    print(found)
    if not found.converged:
        print("ftbias: the search did not converge; the values are the best so far", file=sys.stderr)
    found.save(arguments.output)
    print(f"wrote {arguments.output}")
    return 0 if found.converged else 1
