"""``ftbias identify``: the tool's inertial parameters from a log, or from static poses."""

from __future__ import annotations

import argparse

from ftbias_jax.cli.repairs import tell_repairs
from ftbias_jax.io import read_motion
from ftbias_jax.io.outputs import check_outputs, output_of_setup
from ftbias_jax.setup import load_setup


def run(arguments: argparse.Namespace) -> int:
    """Identify the tool and write a setup that has it; 3 if samples were lost."""
    output, kept = output_of_setup(arguments.output, arguments.setup, arguments.in_place)
    setup = load_setup(arguments.setup)
    check_outputs({"--output": output}, (arguments.log, *kept, setup.urdf))
    log = read_motion(arguments.log, setup)

    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.calibration.identify_tool import identify_tool

    found = identify_tool(
        setup,
        log,
        mounting=arguments.mounting,
        gravity=arguments.gravity,
        bias=arguments.bias,
        unchecked=arguments.unchecked,
    )
    print(found)
    code = tell_repairs([(arguments.log, log.repairs)])
    found.save(output)
    print(f"wrote {output}")
    return code
