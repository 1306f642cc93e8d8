"""Arguments of ``ftbias filter``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ftbias_jax.cli.argument_types import (
    Commands,
    add_archive,
    add_effects,
    add_force,
    add_outside,
    add_unchecked,
    count,
    fields,
    gate,
    positive,
)

if TYPE_CHECKING:
    from ftbias_jax.io.write.selection import Selection


def add_filter(commands: Commands) -> None:
    """The command ``filter``."""
    parser = commands.add_parser(
        "filter",
        help="estimate bias and drift of logs and correct their wrench",
        description="Estimate bias and drift at every wrench sample of LOG, and write them with the corrected wrench. "
        "Where OUT is a folder, all logs are filtered into it, and those that it has already are skipped.",
    )
    parser.add_argument(
        "logs",
        nargs="+",
        metavar="LOG",
        help="log: .npz .csv .parquet .h5 .bag .db3 .mcap or a ROS 2 bag's folder; for a folder OUT also many logs, "
        "folders to search, or patterns in quotes",
    )
    parser.add_argument("--setup", required=True, metavar="SETUP.toml", help="robot, sensor, tool and noise")
    parser.add_argument(
        "-o", "--output", required=True, metavar="OUT", help="the result: .npz .csv .parquet or .mcap, or a folder"
    )
    parser.add_argument("--salvage", action="store_true", help="read what is whole of a damaged recording")
    parser.add_argument("--smooth", action="store_true", help="also write the bias given past and future")
    parser.add_argument("--check", action="store_true", help="also judge whether the filter's error bars are right")
    parser.add_argument("--plot", metavar="OUT.png", help="also draw bias and residual (needs the extra 'plot')")
    parser.add_argument(
        "--offsets", metavar="OUT.yaml", help="also write the bias at the end as offsets that ros2_control adds"
    )
    parser.add_argument(
        "--gate",
        type=gate,
        metavar="SIGMAS",
        help="do not use wrenches farther than this off their prediction: contacts and spikes (6)",
    )
    parser.add_argument(
        "--as-stated",
        action="store_true",
        help="filter as on the robot: joints from the past alone, noise as the setup states, contact not looked for",
    )
    add_unchecked(parser)
    add_effects(parser)
    _add_selection(parser)
    folders = add_archive(parser)
    folders.add_argument(
        "--format", default="npz", choices=["npz", "csv", "parquet", "mcap"], help="of the results (%(default)s)"
    )
    add_outside(parser)
    add_force(parser)


def _add_selection(parser: argparse.ArgumentParser) -> None:
    """The options that say which part of a result is written."""
    group = parser.add_argument_group(
        "what is written",
        "Samples are left out, never averaged: the values are those of the samples that are kept. Bias and error bars "
        "lose nothing; in the corrected wrench, vibration above half the output's rate folds to lower frequencies.",
    )
    group.add_argument(
        "--fields",
        type=fields,
        default=(),
        metavar="NAME[,NAME...]",
        help="arrays to write beside t: bias,bias_std,wrench_unbiased,... as in the reference of results (all)",
    )
    group.add_argument(
        "--precision",
        choices=["single", "double"],
        default="single",
        help="of the numbers; t is double in any case (%(default)s)",
    )
    thinning = group.add_mutually_exclusive_group()
    thinning.add_argument("--every", type=count, default=1, metavar="N", help="write every N-th sample (%(default)s)")
    thinning.add_argument(
        "--output-rate", type=positive, metavar="HZ", help="write at most so many samples a second (all)"
    )


def selection_of(arguments: argparse.Namespace) -> Selection:
    """What of the result the command line asks for."""
    from ftbias_jax.io.write.selection import Selection

    return Selection(arguments.fields, arguments.precision, arguments.every, arguments.output_rate)
