"""Make labelled logs with physics independent of the package's, and score the diagnosis on them."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

if not __package__:  # python experiments/validation puts the folder itself first on the path
    sys.path[0] = str(Path(__file__).resolve().parents[1])
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: threads for small matrices block each other

from ftbias_jax.cli.options import count, positive, seed
from ftbias_jax.cli.terminal import warn
from ftbias_jax.errors import FtbiasError, OutputError, UsageError
from ftbias_jax.io.atomic import make_folder, write_json
from ftbias_jax.io.write.outputs import check_outputs
from ftbias_jax.runtime.progress import Progress

MOST_SAMPLES = 10_000_000
"""Limit on the samples of one simulated log, because more do not fit the memory."""
INTERRUPTED = "validation: interrupted, nothing more was written"


def main(words: Sequence[str] | None = None) -> int:
    """Make or score a set of logs; returns 0, or 1 for a failure, 2 for wrong arguments, 3 if samples were lost."""
    if words is None:  # run as a program
        from ftbias_jax.runtime.signals import end_on_signals

        end_on_signals(f"{INTERRUPTED}\n")
    arguments = parser().parse_args(words)
    try:
        return make(arguments) if arguments.action == "make" else score(arguments)
    except FtbiasError as error:
        print(f"validation: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(INTERRUPTED, file=sys.stderr)
        return 1


def numbers(text: str) -> tuple[float, ...]:
    """Parse positive numbers separated by commas."""
    return tuple(map(positive, text.split(",")))


def parser() -> argparse.ArgumentParser:
    """Build the parser for the arguments of both actions."""
    whole = argparse.ArgumentParser(
        prog="validation",
        description=__doc__,
        epilog="Example: python experiments/validation make SET --count 128 --seed 1, then score SET --jobs 2",
    )
    actions = whole.add_subparsers(dest="action", required=True, metavar="make|score")
    maker = actions.add_parser("make", help="make logs by MuJoCo")
    maker.add_argument("output", metavar="OUT", help="new folder for logs, setups and truth.json")
    maker.add_argument("--count", type=count, default=128, metavar="N", help="logs (%(default)s)")
    maker.add_argument("--seed", type=seed, default=0, metavar="S", help="the same makes the same logs (%(default)s)")
    maker.add_argument(
        "--protocol",
        choices=("effects", "unlisted"),
        default="effects",
        help="unlisted: kinds that no catalogue knows, each in two logs of other motion (%(default)s)",
    )
    effects = "all, catalogue, none, pairs, unlisted or names, by commas (all); of the protocol effects"
    maker.add_argument("--effects", metavar="NAMES", help=effects)
    kinds = "which kinds of the protocol unlisted (seen); unseen ones are for the end, not for building"
    maker.add_argument("--kinds", choices=("seen", "unseen", "all", "events"), help=kinds)
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
    return whole


def make(arguments: argparse.Namespace) -> int:
    """Write logs, setups and labels into a folder; returns 0.

    Raises:
        UsageError: an effect is unknown, or an option belongs to the other protocol. OutputError: the folder cannot be
            made or already holds a set.
    """
    unlisted = arguments.protocol == "unlisted"
    for option, value, fits in (("--effects", arguments.effects, not unlisted), ("--kinds", arguments.kinds, unlisted)):
        if value is not None and not fits:
            raise UsageError(f"says nothing to the protocol {arguments.protocol}", field=option)
    from validation.generator.kinds import logs as unlisted_logs
    from validation.generator.make import Limits, make_set
    from validation.generator.plan import make_plan

    limits = Limits((min(arguments.duration), max(arguments.duration)), arguments.rate, arguments.plain)
    asked = arguments.kinds or "seen" if unlisted else arguments.effects or "all"
    if not unlisted:
        try:
            make_plan(asked, 0, 0)
        except ValueError as error:
            raise UsageError(str(error), field="--effects") from error
    samples = max(arguments.duration) * max(arguments.rate)
    if samples > MOST_SAMPLES:
        remedy = f"ask for at most {MOST_SAMPLES} samples: seconds times rate"
        raise UsageError(f"{samples:.3g} samples a log do not fit the memory", field="--duration", remedy=remedy)
    folder = Path(arguments.output)
    make_folder(folder)
    if any(folder.glob("log_*")) or any((folder / name).exists() for name in ("truth.json", "second", "extra")):
        raise OutputError("holds a set already", file=folder, remedy="name a new folder")
    write = unlisted_logs.make_set if unlisted else make_set
    logs = "pairs of logs" if unlisted else "logs"
    report = Progress(f"making {arguments.count} {logs}", arguments.count)
    write(folder, asked, arguments.count, arguments.seed, limits, arguments.jobs, report)
    print(f"wrote {arguments.count} {logs} with their setups and truth.json to {folder}")
    return 0


def score(arguments: argparse.Namespace) -> int:
    """Diagnose every log of a set, then open its labels and score the diagnoses.

    Returns:
        1 if a diagnosis failed, else 3 if samples were lost, else 0.
    """
    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from validation.protocols import leave_one_out, withheld
    from validation.runs import find_logs, verdict_path

    folder = Path(arguments.folder)
    protocol, verdicts = (leave_one_out, "verdicts_without") if arguments.leave_one_out else (withheld, "verdicts")
    out = Path(arguments.out or folder / verdicts)
    path = arguments.json or str(out / "score.json")
    logs = find_logs(folder)
    outputs = {"--json": path, **{f"the verdict on {log.name!r}": verdict_path(out, log) for log in logs}}
    beside = (path for place in ("second", "extra") for path in (folder / place).rglob("*") if path.is_file())
    check_outputs(outputs, (*logs, *(log.with_suffix(".toml") for log in logs), folder / "truth.json", *beside))
    result = protocol(folder, logs, out, arguments.jobs)
    print(result.text)
    write_json(path, result.content)
    print(f"wrote {path}; verdicts in {out} are kept, delete them to diagnose anew")
    for log, trouble in result.troubles.items():
        warn(f"{log}: no diagnosis: {trouble}")
    for loss in result.losses:
        warn(loss)
    return 1 if result.troubles else 3 if result.losses else 0


if __name__ == "__main__":
    sys.exit(main())
