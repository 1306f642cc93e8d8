"""Command line: parses arguments before anything heavy is imported, prints, and turns known errors into exit codes.

Exit codes: 0 ok, 1 failed, 2 usage, 3 finished with data loss.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Callable, Sequence

from ftbias_jax import __version__
from ftbias_jax.errors import FtbiasError
from ftbias_jax.option_kinds import count, gate, numbers, positive, process, restarts, seed, shard, share


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code. Known errors become one line on standard error."""
    parsed = build_parser().parse_args(arguments)
    # The matrices are small: threads of BLAS that wait for one another cost more than they save.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
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
    for add in (_add_filter, _add_tune, _add_identify, _add_simulate, _add_diagnose, _add_info, _add_blind, _add_demo):
        add(commands)
    return parser


def _add_filter(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
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
        help="do not use wrenches farther than this off their prediction: contacts and spikes (5 is usual)",
    )
    folders = parser.add_argument_group("for a folder OUT")
    folders.add_argument("--jobs", type=count, default=1, metavar="N", help="logs at a time (%(default)s)")
    folders.add_argument(
        "--shard",
        type=shard,
        default=(1, 1),
        metavar="I/N",
        help="filter only the I-th of N shares, 1/N to N/N",
    )
    folders.add_argument(
        "--format", default="npz", choices=["npz", "csv", "parquet", "mcap"], help="of the results (%(default)s)"
    )


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
        type=restarts,
        default=1,
        metavar="N",
        help="further starts, all values off by random factors, to see whether they agree (%(default)s)",
    )
    parser.add_argument(
        "--hold-out", type=share, default=0.25, metavar="SHARE", help="end of every log kept to judge by (%(default)s)"
    )
    parser.add_argument(
        "--distributed",
        type=process,
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
    parser.add_argument("--duration", type=positive, default=60.0, metavar="S", help="seconds (%(default)s)")
    parser.add_argument("--rate", type=positive, default=500.0, metavar="HZ", help="samples a second (%(default)s)")
    parser.add_argument(
        "--motion", default="sines", metavar="sines|moves|FILE", help="motion, or a log to replay (%(default)s)"
    )
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="of the random numbers (%(default)s)")


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


def _add_blind(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = commands.add_parser(
        "blind",
        help="check the diagnosis on logs whose cause is withheld",
        description="Make labelled logs by physics that are not this package's, and score the diagnosis on them.",
        epilog="Example: ftbias blind make SET --count 128 --seed 1, then ftbias blind score SET --jobs 2",
    )
    actions = parser.add_subparsers(dest="action", required=True, metavar="make|score")
    maker = actions.add_parser("make", help="make logs by MuJoCo (needs the extra 'blind')")
    maker.add_argument("output", metavar="OUT", help="new folder for logs, setups and truth.json")
    maker.add_argument("--count", type=count, default=128, metavar="N", help="logs (%(default)s)")
    maker.add_argument("--seed", type=seed, default=0, metavar="S", help="the same makes the same logs (%(default)s)")
    effects = "all, catalogue, none, pairs, unlisted or names, by commas (%(default)s)"
    maker.add_argument("--effects", default="all", metavar="NAMES", help=effects)
    maker.add_argument(
        "--duration", type=numbers, default=(20.0, 60.0), metavar="S[,S]", help="shortest,longest (20,60)"
    )
    rates = (125.0, 200.0, 250.0, 400.0, 500.0)
    maker.add_argument("--rate", type=numbers, default=rates, metavar="HZ[,...]", help="to choose from (125 to 500)")
    maker.add_argument("--plain", action="store_true", help="one clock and all velocities in every log")
    scorer = actions.add_parser("score", help="diagnose every log of a set, then open truth.json and score")
    scorer.add_argument("folder", metavar="DIR", help="a set: log_*.npz, log_*.toml, truth.json")
    scorer.add_argument("--out", metavar="VERDICTS", help="folder of the verdicts; those there are kept (DIR/verdicts)")
    scorer.add_argument("--json", metavar="OUT.json", help="where to write the score (VERDICTS/score.json)")
    scorer.add_argument(
        "--leave-one-out", action="store_true", help="leave each log's true effect out of the catalogue instead"
    )
    for one in (maker, scorer):
        one.add_argument("--jobs", type=count, default=1, metavar="N", help="processes (%(default)s)")


def _add_demo(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
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


if __name__ == "__main__":
    sys.exit(main())
