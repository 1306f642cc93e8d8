"""``ftbias validate``: make logs whose cause is withheld, and score the diagnosis on them."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from types import ModuleType

from ftbias_jax.cli.repairs import warn
from ftbias_jax.errors import OutputError, UsageError
from ftbias_jax.io.atomic import make_folder, write_json
from ftbias_jax.io.outputs import check_outputs
from ftbias_jax.runtime.progress import Progress

MOST_SAMPLES = 10_000_000
"""Of one made log."""


def run(arguments: argparse.Namespace) -> int:
    """Make a set of logs, or score one."""
    return make(arguments) if arguments.action == "make" else score(arguments)


def make(arguments: argparse.Namespace) -> int:
    """Write logs, setups and labels into a folder; returns 0.

    Raises:
        UsageError: an unknown effect, or an option of the other protocol. OutputError: MuJoCo is missing, or the folder
            cannot be made or holds a set already.
    """
    unlisted = arguments.protocol == "unlisted"
    for option, value, fits in (("--effects", arguments.effects, not unlisted), ("--kinds", arguments.kinds, unlisted)):
        if value is not None and not fits:
            raise UsageError(f"says nothing to the protocol {arguments.protocol}", field=option)
    generator = _generator("make")
    limits = generator.Limits((min(arguments.duration), max(arguments.duration)), arguments.rate, arguments.plain)
    asked = arguments.kinds or "seen" if unlisted else arguments.effects or "all"
    if not unlisted:
        try:
            generator.make_plan(asked, 0, 0)
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
    maker = _generator("kinds.logs") if unlisted else generator
    logs = "pairs of logs" if unlisted else "logs"
    report = Progress(f"making {arguments.count} {logs}", arguments.count)
    maker.make_set(folder, asked, arguments.count, arguments.seed, limits, arguments.jobs, report)
    print(f"wrote {arguments.count} {logs} with their setups and truth.json to {folder}")
    return 0


def score(arguments: argparse.Namespace) -> int:
    """Diagnose every log of a set, then open its labels and score.

    Returns:
        1 if a diagnosis failed, else 3 if samples were lost, else 0.
    """
    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.validation.protocols import leave_one_out, withheld
    from ftbias_jax.validation.runs import find_logs, verdict_path

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


def _generator(module: str) -> ModuleType:
    """A module of the maker of logs, which needs what the package itself does not."""
    try:
        return importlib.import_module(f"ftbias_jax.validation.generator.{module}")
    except ModuleNotFoundError as error:
        message = f"making logs needs {error.name}, which is not installed"
        raise OutputError(message, remedy="pip install 'ftbias-jax[validation]'") from error
