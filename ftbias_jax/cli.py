"""Command line: parses arguments before anything heavy is imported, prints, and turns known errors into exit codes.

Exit codes: 0 ok, 1 failed, 2 usage, 3 finished with data loss.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable, Sequence

from ftbias_jax import __version__
from ftbias_jax.errors import FtbiasError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code. Known errors become one line on standard error."""
    parsed = build_parser().parse_args(arguments)
    try:
        # A command's module is imported only now: JAX alone costs half a second.
        run: Callable[[argparse.Namespace], int] = importlib.import_module(f"ftbias_jax.commands.{parsed.command}").run
        return run(parsed)
    except FtbiasError as error:
        print(f"ftbias: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("ftbias: interrupted, nothing more was written", file=sys.stderr)
        return 1
    except BrokenPipeError:
        return 1


def build_parser() -> argparse.ArgumentParser:
    """The whole command line."""
    parser = argparse.ArgumentParser(
        prog="ftbias",
        description="Bias and drift of a wrist force-torque sensor from a recorded log.",
        epilog="Exit codes: 0 ok, 1 failed, 2 usage, 3 finished with data loss.",
    )
    parser.add_argument("--version", action="version", version=f"ftbias {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add_filter(commands)
    _add_tune(commands)
    _add_identify(commands)
    _add_simulate(commands)
    _add_diagnose(commands)
    _add_info(commands)
    _add_demo(commands)
    return parser


def _add_filter(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = commands.add_parser(
        "filter",
        help="estimate bias and drift of one log and correct its wrench",
        description="Estimate bias and drift at every wrench sample of LOG, and write them with the corrected wrench.",
    )
    parser.add_argument(
        "log", metavar="LOG", help="log: .npz .csv .parquet .h5 .bag .db3 .mcap or a ROS 2 bag's folder"
    )
    parser.add_argument("--setup", required=True, metavar="SETUP.toml", help="robot, sensor, tool and noise")
    parser.add_argument(
        "-o", "--output", required=True, metavar="OUT", help="where to write the result: .npz .csv .parquet or .mcap"
    )
    parser.add_argument("--salvage", action="store_true", help="read what is whole of a damaged recording")
    parser.add_argument("--smooth", action="store_true", help="also write the bias given past and future")
    parser.add_argument("--check", action="store_true", help="also judge whether the filter's error bars are right")
    parser.add_argument("--plot", metavar="OUT.png", help="also draw bias and residual (needs the extra 'plot')")


def _add_tune(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = commands.add_parser(
        "tune",
        help="fit the noise parameters to logs by maximum likelihood",
        description="Fit the noise of joints, bias and sensor to LOGs of one robot, and write a setup with the result.",
    )
    parser.add_argument("logs", nargs="+", metavar="LOG", help="logs of the same robot and sensor")
    parser.add_argument(
        "--setup", required=True, metavar="SETUP.toml", help="robot, sensor, tool and noise to start from"
    )
    parser.add_argument("-o", "--output", required=True, metavar="TUNED.toml", help="where to write the tuned setup")
    parser.add_argument(
        "--fit",
        nargs="+",
        default=["joints", "bias", "sensor"],
        choices=["joints", "bias", "sensor"],
        help="what to fit: joint noise, sigma_Q, sensor noise (all)",
    )
    parser.add_argument(
        "--tie",
        default="each",
        choices=["each", "pair", "one"],
        help="sigma_Q and sensor noise: one value for each axis, for forces and torques, or for all (%(default)s)",
    )
    parser.add_argument(
        "--restarts",
        type=_count,
        default=1,
        metavar="N",
        help="further starts, all values off by random factors, to see whether they agree (%(default)s)",
    )
    parser.add_argument(
        "--hold-out", type=_share, default=0.25, metavar="SHARE", help="end of every log kept to judge by (%(default)s)"
    )
    parser.add_argument(
        "--distributed",
        type=_process,
        nargs="?",
        const=(None, None, None),
        metavar="HOST:PORT,N,I",
        help="one of N processes, the I-th from 0, that share the logs; nothing to give under Slurm or MPI",
    )


def _add_identify(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = commands.add_parser(
        "identify",
        help="find the tool's mass, centre of mass and inertia from a log",
        description="Fit the tool's inertial parameters, physically consistent, jointly with the bias.",
    )
    parser.add_argument("log", metavar="LOG", help="log of free motion that turns the wrist")
    parser.add_argument("--setup", required=True, metavar="SETUP.toml", help="robot, sensor, and a tool to start from")
    parser.add_argument("-o", "--output", required=True, metavar="OUT.toml", help="where to write the setup found")
    parser.add_argument("--mounting", action="store_true", help="also find how the sensor is turned on the flange")
    parser.add_argument("--gravity", action="store_true", help="also find the direction of gravity")


def _add_simulate(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
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
    parser.add_argument("--duration", type=_positive, default=60.0, metavar="S", help="seconds (%(default)s)")
    parser.add_argument("--rate", type=_positive, default=500.0, metavar="HZ", help="samples a second (%(default)s)")
    parser.add_argument(
        "--motion", default="sines", metavar="sines|moves|FILE", help="motion, or a log to replay (%(default)s)"
    )
    parser.add_argument("--seed", type=_seed, default=0, metavar="N", help="of the random numbers (%(default)s)")


def _add_diagnose(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = commands.add_parser(
        "diagnose",
        help="find where logs depart from the model, why, and how far the gap shrinks",
        description="Find which effects that the setup does not know cause the gap between LOGs and model.",
        epilog="Example: ftbias diagnose LOG.npz --setup SETUP.toml --html REPORT.html --apply -o FIXED.toml",
    )
    parser.add_argument("logs", nargs="+", metavar="LOG", help="logs of the same robot, sensor and tool")
    parser.add_argument("--setup", required=True, metavar="SETUP.toml", help="robot, sensor, tool and noise")
    parser.add_argument("--json", metavar="OUT.json", help="also write the diagnosis for programs")
    parser.add_argument("--html", metavar="OUT.html", help="also write a report with plots, one file")
    parser.add_argument("--apply", action="store_true", help="also write a setup that has the causes as effects")
    parser.add_argument("-o", "--output", metavar="FIXED.toml", help="where to write that setup")
    parser.add_argument(
        "--without", action="append", default=[], metavar="EFFECT", help="leave this effect out; may be repeated"
    )


def _add_info(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = commands.add_parser(
        "info",
        help="show what is in a log and what can be filtered from it",
        description="Show streams, rates, gaps, stuck or saturated axes and joint names of LOG.",
    )
    parser.add_argument("log", metavar="LOG", help="any log: .npz .csv .parquet .h5 .bag .db3 .mcap or a bag's folder")
    parser.add_argument("--setup", metavar="SETUP.toml", help="also tell whether LOG can be filtered with it")


def _add_demo(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = commands.add_parser(
        "demo",
        help="simulate a Panda with a drifting sensor and filter it; needs no files",
        description="Simulate a Panda log with a drifting bias, filter it, and compare with the truth.",
    )
    parser.add_argument("-o", "--output", default="ftbias_demo", metavar="DIR", help="folder to write (%(default)s)")
    parser.add_argument("--duration", type=_positive, default=60.0, metavar="S", help="seconds (%(default)s)")
    parser.add_argument("--rate", type=_positive, default=500.0, metavar="HZ", help="samples a second (%(default)s)")
    parser.add_argument("--seed", type=_seed, default=0, metavar="N", help="of the random numbers (%(default)s)")


def _seed(text: str) -> int:
    if not text.isdecimal() or int(text) >= 2**32:
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 to {2**32 - 1}, not {text!r}")
    return int(text)


def _process(text: str) -> tuple[str, int, int]:
    coordinator, *numbers = text.split(",")
    if ":" in coordinator and len(numbers) == 2 and all(x.isdecimal() for x in numbers):
        count, index = map(int, numbers)
        if index < count:
            return coordinator, count, index
    raise argparse.ArgumentTypeError(f"must be HOST:PORT,N,I with I from 0 to N - 1, not {text!r}")


def _count(text: str) -> int:
    """A whole number of something, 0 or more."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0")
    return int(text)


def _share(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 0.9:
        raise argparse.ArgumentTypeError(f"must be a share from 0 to 0.9, not {text!r}")
    return value


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a positive number, not {text!r}")
    return value


if __name__ == "__main__":
    sys.exit(main())
