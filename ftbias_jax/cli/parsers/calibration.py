"""Arguments of ``ftbias tune``, ``ftbias identify`` and ``ftbias calibrate``."""

from __future__ import annotations

from ftbias_jax.cli.argument_types import (
    LOGS,
    Commands,
    add_archive,
    add_effects,
    add_force,
    add_outside,
    add_unchecked,
    process,
    restarts,
    share,
)


def add_tune(commands: Commands) -> None:
    """The command ``tune``."""
    parser = commands.add_parser(
        "tune",
        help="fit the noise parameters to logs by maximum likelihood",
        description="Fit the noise of joints, bias and sensor to LOGs of one robot, and write a setup with the result.",
    )
    parser.add_argument("logs", nargs="*", metavar="LOG", help=LOGS)
    parser.add_argument(
        "--setup",
        required=True,
        nargs="+",
        action="append",
        metavar=("SETUP.toml", "LOG"),
        help="robot, sensor, tool and noise to start from; with --fit data one --setup for each of several tools, each "
        "followed by its logs",
    )
    parser.add_argument(
        "-o",
        "--output",
        action="append",
        metavar="OUT",
        help="where to write the tuned setup, one -o for each --setup, in their order; or a folder: tune to each log "
        "by itself into it",
    )
    parser.add_argument("--in-place", action="store_true", help="replace SETUP.toml by the result")
    parser.add_argument(
        "--fit",
        nargs="+",
        default=["joints", "bias", "sensor"],
        choices=["joints", "bias", "sensor", "data"],
        help="what to fit: joint noise, sigma_Q, sensor noise (these three), and Sigma_D, noise of the motion at the "
        "sensor",
    )
    parser.add_argument(
        "--data-noise",
        default="one",
        choices=["one", "three", "entries"],
        help="Sigma_D: one number each for linear acceleration, angular acceleration, rate and gravity, three for the "
        "axes of the sensor, or all entries of D (%(default)s)",
    )
    parser.add_argument(
        "--tie",
        default="each",
        choices=["each", "pair", "one"],
        help="sigma_Q and sensor noise: one value for each axis, for forces and torques, or for all (%(default)s)",
    )
    parser.add_argument(
        "--restarts",
        type=restarts,
        default=1,
        metavar="N",
        help="further starts, all values off by random factors, to see whether they agree (%(default)s)",
    )
    parser.add_argument(
        "--hold-out", type=share, default=0.25, metavar="SHARE", help="end of every log kept to judge by (%(default)s)"
    )
    parser.add_argument(
        "--force", action="store_true", help="write the result even if it predicts unseen data worse than the setup"
    )
    parser.add_argument(
        "--distributed",
        type=process,
        nargs="?",
        const=(None, None, None),
        metavar="HOST:PORT,N,I",
        help="one of N processes, the I-th from 0, that share the logs; nothing to give under Slurm or MPI",
    )
    add_unchecked(parser)
    add_effects(parser)
    add_archive(parser)
    add_outside(parser)


def add_identify(commands: Commands) -> None:
    """The command ``identify``."""
    parser = commands.add_parser(
        "identify",
        help="find the tool's mass, centre of mass and inertia from a log",
        description="Fit the tool's inertial parameters, physically consistent, jointly with the bias.",
    )
    parser.add_argument(
        "logs",
        nargs="+",
        metavar="LOG",
        help="log of free motion that turns the wrist, or a table of 4 to 1000 static poses, with or without time; for "
        "a folder OUT also many of them, folders to search, or patterns in quotes",
    )
    parser.add_argument("--setup", required=True, metavar="SETUP.toml", help="robot, sensor, and a tool to start from")
    parser.add_argument(
        "-o", "--output", metavar="OUT", help="where to write the setup found; or a folder for each log's"
    )
    parser.add_argument("--in-place", action="store_true", help="replace SETUP.toml by the result")
    parser.add_argument("--mounting", action="store_true", help="also find how the sensor is turned on the flange")
    parser.add_argument("--gravity", action="store_true", help="also find the direction of gravity")
    parser.add_argument(
        "--bias",
        action="store_true",
        help="also write the bias of LOG with its standard error, as the prior of logs recorded next",
    )
    parser.add_argument(
        "--crosstalk",
        action="store_true",
        help="also find the gains of the sensor's channels and the leaks between them, if LOG shows them",
    )
    add_unchecked(parser)
    add_archive(parser)
    add_outside(parser)
    add_force(parser)


def add_calibrate(commands: Commands) -> None:
    """The command ``calibrate``."""
    parser = commands.add_parser(
        "calibrate",
        help="from logs to a setup: draft, diagnose, identify, and keep what predicts unseen data better",
        description="Draft or take a setup, find causes of the gap and the tool, and keep each step only if the setup "
        "with it predicts the end of LOGs, which it has not seen, better than without.",
        epilog="Example: ftbias calibrate monday.bag --robot ur10e -o setup.toml --html calibration.html",
    )
    parser.add_argument("logs", nargs="+", metavar="LOG", help=LOGS)
    parser.add_argument("--setup", metavar="SETUP.toml", help="where to start (default: a draft from the first log)")
    parser.add_argument("--robot", default="", metavar="NAME", help="of the draft: a built-in robot")
    parser.add_argument("--urdf", default="", metavar="FILE", help="of the draft: a URDF instead")
    parser.add_argument("-o", "--output", required=True, metavar="OUT.toml", help="where to write the setup")
    parser.add_argument("--html", metavar="OUT.html", help="also write a page: steps, errors, and the setup")
    parser.add_argument("--json", metavar="OUT.json", help="also write steps and errors for programs")
    parser.add_argument(
        "--bias",
        action="store_true",
        help="also write the bias at the end of the longest log, as the prior of logs recorded next",
    )
    parser.add_argument(
        "--hold-out", type=share, default=0.25, metavar="SHARE", help="end of every log kept to judge by (%(default)s)"
    )
    add_unchecked(parser)
    add_outside(parser)
    add_force(parser)
