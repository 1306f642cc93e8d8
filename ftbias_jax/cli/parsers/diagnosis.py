"""Arguments of ``ftbias diagnose`` and ``ftbias effects``."""

from __future__ import annotations

from ftbias_jax.cli.argument_types import (
    LOGS,
    Commands,
    add_archive,
    add_effects,
    add_force,
    add_outside,
    add_unchecked,
)


def add_diagnose(commands: Commands) -> None:
    """The command ``diagnose``."""
    parser = commands.add_parser(
        "diagnose",
        help="find where logs depart from the model, why, and how far the gap shrinks",
        description="Find which effects that the setup does not know cause the gap between LOGs and model.",
        epilog="Example: ftbias diagnose LOG.npz --setup SETUP.toml --html REPORT.html --apply -o FIXED.toml",
    )
    parser.add_argument("logs", nargs="+", metavar="LOG", help=LOGS)
    parser.add_argument("--setup", required=True, metavar="SETUP.toml", help="robot, sensor, tool and noise")
    parser.add_argument("--json", metavar="OUT.json", help="also write the diagnosis for programs")
    parser.add_argument("--html", metavar="OUT.html", help="also write a report with plots, one file")
    parser.add_argument("--apply", action="store_true", help="also write a setup that has the causes as effects")
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT",
        help="where to write that setup; or a folder: diagnose each log alone into it, with --apply a setup for each",
    )
    parser.add_argument("--in-place", action="store_true", help="let --apply replace SETUP.toml")
    parser.add_argument(
        "--without", action="append", default=[], metavar="EFFECT", help="leave this effect out; may be repeated"
    )
    add_unchecked(parser)
    add_effects(parser)
    add_archive(parser)
    add_outside(parser)
    add_force(parser)


def add_effects_command(commands: Commands) -> None:
    """The command ``effects``."""
    parser = commands.add_parser(
        "effects",
        help="list and describe the effects that are looked for, or check your own",
        description="List all effects; describe those named; or find faults in a Python file with your own.",
        epilog="Examples: ftbias effects; ftbias effects cable; ftbias effects check my_effects.py",
    )
    parser.add_argument("words", nargs="*", metavar="NAME", help="effects to describe; or: check FILE.py")
    add_effects(parser)
