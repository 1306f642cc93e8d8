"""``ftbias --print-completion``: what makes a shell complete commands and options."""

from __future__ import annotations

import argparse
import importlib
from typing import Any

SHELLS = ("bash", "zsh", "tcsh")


class PrintCompletion(argparse.Action):
    """Print the script for a shell, and end; needs the extra 'completion'."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """As argparse calls it."""
        try:
            shtab = importlib.import_module("shtab")
        except ImportError:
            parser.error("needs the package shtab (pip install 'ftbias-jax[completion]')")
        print(shtab.complete(parser, values), flush=True)
        parser.exit()
