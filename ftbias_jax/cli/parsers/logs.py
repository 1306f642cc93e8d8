"""Arguments of ``ftbias simulate``, ``ftbias info`` and ``ftbias demo``."""

from __future__ import annotations

from ftbias_jax.cli.argument_types import (
    LOGS,
    Commands,
    add_archive,
    add_effects,
    add_force,
    add_outside,
    positive,
    seed,
)


def add_simulate(commands: Commands) -> None:
    """The command ``simulate``."""
    parser = commands.add_parser(
        "simulate",
        help="make a log with known truth, with any effects",
        description="Simulate a log of the setup's robot, sensor and tool, and write what is true to another file.",
        epilog="Example: ftbias simulate --setup SETUP.toml --effect tool_mass:mass=0.8 --effect time_delay -o LOG.npz",
    )
    parser.add_argument("--setup", required=True, metavar="SETUP.toml", help="robot, sensor, tool, noise and effects")
    parser.add_argument("-o", "--output", required=True, metavar="LOG.npz", help="where to write the log")
    parser.add_argument("--truth", metavar="FILE", help=".npz or .json with the truth (default: LOG_truth.npz)")
    parser.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="NAME[:key=value,...]",
        help="what the setup does not know; vectors as 1/2/3; typical values if none are given; may be repeated",
    )
    parser.add_argument("--duration", type=positive, default=60.0, metavar="S", help="seconds (%(default)s)")
    parser.add_argument("--rate", type=positive, default=500.0, metavar="HZ", help="samples a second (%(default)s)")
    parser.add_argument(
        "--motion", default="sines", metavar="sines|moves|FILE", help="motion, or a log to replay (%(default)s)"
    )
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="of the random numbers (%(default)s)")
    add_effects(parser)
    add_outside(parser)
    add_force(parser)


def add_info(commands: Commands) -> None:
    """The command ``info``."""
    parser = commands.add_parser(
        "info",
        help="show what is in a log and what can be filtered from it",
        description="Show streams, rates, gaps, stuck or saturated axes and joint names of LOG.",
    )
    parser.add_argument("log", metavar="LOG", help="any log: .npz .csv .parquet .h5 .bag .db3 .mcap or a bag's folder")
    parser.add_argument("--setup", metavar="SETUP.toml", help="also tell whether LOG can be filtered with it")
    add_outside(parser)


def add_check(commands: Commands) -> None:
    """The command ``check``."""
    parser = commands.add_parser(
        "check",
        help="see from logs whether a setup can be right: signs, units, frames",
        description="Say which mistakes of sign, unit, frame or convention LOGs show in a setup, and what to write "
        "instead. Exits with 1 if there are any. The other commands look for the same first.",
    )
    parser.add_argument("logs", nargs="+", metavar="LOG", help=LOGS)
    parser.add_argument("--setup", required=True, metavar="SETUP.toml", help="robot, sensor, tool and noise")
    parser.add_argument("--json", metavar="OUT.json", help="also write the findings for programs")
    parser.add_argument("-o", "--output", metavar="FOLDER", help="check each log by itself, into this folder")
    add_archive(parser)
    add_outside(parser)
    add_force(parser)


def add_demo(commands: Commands) -> None:
    """The command ``demo``."""
    parser = commands.add_parser(
        "demo",
        help="simulate a Panda that is not as its setup says, filter, diagnose and mend it; needs no files",
        description="Simulate a Panda log with an effect its setup does not know, filter it, find the effect, put it "
        "into the setup, filter again, and compare with the truth.",
    )
    parser.add_argument("-o", "--output", default="ftbias_demo", metavar="DIR", help="folder to write (%(default)s)")
    parser.add_argument("--duration", type=positive, default=30.0, metavar="S", help="seconds (%(default)s)")
    parser.add_argument("--rate", type=positive, default=250.0, metavar="HZ", help="samples a second (%(default)s)")
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="of the random numbers (%(default)s)")


def add_compare(commands: Commands) -> None:
    """The command ``compare``."""
    parser = commands.add_parser(
        "compare",
        help="show what differs between two setups, results, diagnoses or checks",
        description="Show the keys of two setups, the arrays of two results, or the values of two JSON files that "
        "differ. The exit code is 1 if anything does.",
    )
    parser.add_argument("one", metavar="ONE", help="a setup (.toml), a result (.npz), a diagnosis or a check (.json)")
    parser.add_argument("two", metavar="TWO", help="another of the same kind")


def add_report(commands: Commands) -> None:
    """The command ``report``."""
    parser = commands.add_parser(
        "report",
        help="show what the logs of a fleet show together, or one result, as a page",
        description="Read the manifests in FOLDERs, and write which logs have a gap and why, bias and residual over "
        "time by robot and sensor, and alarms: a bias that ages, a cause that appears. Of one RESULT.npz of ftbias "
        "filter, write its bias over time.",
        epilog="Example: ftbias report results -o fleet.html",
    )
    parser.add_argument(
        "folders", nargs="+", metavar="FOLDER", help="results of filter, check and diagnose; or one RESULT.npz"
    )
    parser.add_argument("-o", "--output", required=True, metavar="PAGE.html", help="where to write the page")
    add_force(parser)
