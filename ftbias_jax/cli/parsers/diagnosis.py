"""Arguments of ``ftbias diagnose`` and ``ftbias validate``."""

from __future__ import annotations

from ftbias_jax.cli.argument_types import (
    LOGS,
    Commands,
    add_archive,
    add_effects,
    add_force,
    add_outside,
    add_unchecked,
    count,
    numbers,
    seed,
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


def add_validate(commands: Commands) -> None:
    """The command ``validate``."""
    parser = commands.add_parser(
        "validate",
        help="check the diagnosis on logs whose cause is withheld",
        description="Make labelled logs by physics that are not this package's, and score the diagnosis on them.",
        epilog="Example: ftbias validate make SET --count 128 --seed 1, then ftbias validate score SET --jobs 2",
    )
    actions = parser.add_subparsers(dest="action", required=True, metavar="make|score")
    maker = actions.add_parser("make", help="make logs by MuJoCo (needs the extra 'validation')")
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
    maker.add_argument("--kinds", choices=("seen", "unseen", "all"), help=kinds)
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
