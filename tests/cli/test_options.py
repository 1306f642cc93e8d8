"""Values that options accept, and their reasons for refusing others; the table of commands names existing code."""

import importlib
from argparse import ArgumentTypeError

import pytest

from ftbias_jax.cli import options as kinds
from ftbias_jax.cli.commands.simulators.export import OF_SIMULATORS
from ftbias_jax.cli.options import COMMANDS
from ftbias_jax.io.write.mcap import LAYOUTS
from ftbias_jax.setup.export import FORMATS
from ftbias_jax.setup.robots import CONVENTIONS, UNITS


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_a_function(name):
    module, _, function = COMMANDS[name].get("where", name).partition(":")
    assert callable(getattr(importlib.import_module(f"ftbias_jax.cli.commands.{module}"), function or "run"))


@pytest.mark.parametrize(
    ("command", "option", "words"),
    [
        ("setup", "--dh-convention", CONVENTIONS),
        ("setup", "--dh-units", UNITS),
        ("export", "--format", (*FORMATS, *OF_SIMULATORS, *LAYOUTS)),
    ],
)
def test_words_to_choose_from_are_those_of_the_code(command, option, words):
    assert tuple(COMMANDS[command]["options"][option]["choices"].split()) == tuple(words)


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (kinds.count, "100000", 100_000),
        (kinds.restarts, "0", 0),
        (kinds.seed, "4294967295", 2**32 - 1),
        (kinds.positive, "1e-3", 1e-3),
        (kinds.share, "0.9", 0.9),
        (kinds.gate, "1", 1.0),
        (kinds.shard, "2/2", (2, 2)),
        (kinds.process, "host:1234,4,3", ("host:1234", 4, 3)),
    ],
)
def test_good_values_are_read(kind, text, value):
    assert kind(text) == value


@pytest.mark.parametrize(
    ("kind", "texts", "words"),
    [
        (kinds.count, ["0", "100001", "-1", "1.5", "", "many"], "a whole number from 1 to 100000"),
        (kinds.restarts, ["1025", "-1"], "a whole number from 0 to 1024"),
        (kinds.seed, ["4294967296", "-1"], "a whole number from 0 to 4294967295"),
        (kinds.positive, ["0", "-1", "nan", "inf", ""], "a positive number"),
        (kinds.share, ["-0.1", "0.91", "nan", "half"], "a share from 0 to 0.9"),
        (kinds.gate, ["0.9"], "1 or more standard deviations"),
        (kinds.shard, ["0/2", "3/2", "1"], "I/N with I from 1 to N"),
        (kinds.process, ["host,4,3", "host:1,4,4", "host:1,4", "host:1,a,b"], "HOST:PORT,N,I with I from 0 to N - 1"),
    ],
)
def test_what_else_it_must_be_is_said(kind, texts, words):
    for text in texts:
        with pytest.raises(ArgumentTypeError, match=f"must be {words}, not "):
            kind(text)
