"""Command line: parses arguments before anything heavy is imported, prints, and turns known errors into exit codes.

Exit codes: 0 ok, 1 failed, 2 usage, 3 finished with data loss.
"""

import argparse
import difflib
import importlib
import os
import sys
from collections.abc import Sequence
from typing import Any

from ftbias_jax import __version__
from ftbias_jax.cli.options import COMMANDS, add_command
from ftbias_jax.cli.terminal import print_what_the_terminal_can
from ftbias_jax.errors import FtbiasError
from ftbias_jax.runtime.imports import many_imports

DECIDED_HERE = {
    "JAX_ENABLE_X64": "",  # is often set; commands choose the precision
    "JAX_DEBUG_NANS": "because NaN means that nothing was measured",
    "JAX_DEBUG_INFS": "because NaN means that nothing was measured",
}
"""JAX environment variables that commands ignore, with the reason given in a warning; "" = no warning."""
SHELLS = ("bash", "zsh", "tcsh")
"""Shells for which the extra 'completion' provides scripts."""
INTERRUPTED = "interrupted, nothing more was written"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code. Known errors become one line on standard error."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if arguments is None:  # called as a program
        from ftbias_jax.runtime.signals import end_on_signals

        end_on_signals(f"ftbias: {INTERRUPTED}\n")
    print_what_the_terminal_can()
    for name in DECIDED_HERE:
        if os.environ.pop(name, None) and DECIDED_HERE[name]:
            print(f"warning: {name} is ignored, {DECIDED_HERE[name]}", file=sys.stderr)
    # The matrices are small: threads of BLAS that wait for one another cost more than they save.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        parser = build_parser()
        if misspelt := _misspelt_command(parser, words):
            parser.error(misspelt)
        parsed = parser.parse_args(words)
        # A command's module is imported only now: JAX alone costs half a second.
        module, _, function = parsed.where.partition(":")
        with many_imports():
            command = importlib.import_module(f"ftbias_jax.cli.commands.{module}")
        return int(getattr(command, function or "run")(parsed))
    except FtbiasError as error:
        print(f"ftbias: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"ftbias: {INTERRUPTED}", file=sys.stderr)
        return 1
    except BrokenPipeError:  # the rest of the buffer has no reader either
        if arguments is None:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def build_parser() -> argparse.ArgumentParser:
    """Parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="ftbias",
        description="Bias and drift of a wrist force-torque sensor from a recorded log.",
        epilog="Exit codes: 0 ok, 1 failed, 2 usage, 3 finished with data loss.",
    )
    parser.add_argument("--version", action="version", version=f"ftbias {__version__}")
    parser.add_argument(
        "--print-completion",
        action=PrintCompletion,
        choices=SHELLS,
        metavar="SHELL",
        help=f"print what makes a shell complete commands: {', '.join(SHELLS)}",
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name in COMMANDS:
        add_command(commands, name)
    return parser


class PrintCompletion(argparse.Action):
    """Argparse action that prints a shell's completion script for commands and options, and exits."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: object, shell: Any, *_: object) -> None:
        """Print the script of ``shell`` and exit."""
        try:
            shtab = importlib.import_module("shtab")
        except ImportError:
            parser.error("needs the package shtab (pip install 'ftbias-jax[completion]')")
        print(shtab.complete(parser, shell), flush=True)
        parser.exit()


def _misspelt_command(parser: argparse.ArgumentParser, words: Sequence[str]) -> str:
    """Message about a first word that resembles a command; "" if it is a command, or resembles none."""
    (commands,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    if not words or words[0] in commands.choices:
        return ""
    near = difflib.get_close_matches(words[0], commands.choices, 1)
    return f"there is no command {words[0]!r}: did you mean {near[0]!r}?" if near else ""


if __name__ == "__main__":
    sys.exit(main())
