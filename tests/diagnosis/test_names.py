"""The diagnosis knows no effect by name: what it needs to know of an effect is in the catalogue."""

import ast
import re
from pathlib import Path

import pytest

import ftbias_jax.diagnosis
from ftbias_jax.model.effects.catalogue import CATALOGUE

ROOM = Path(ftbias_jax.diagnosis.__file__).parent
FILES = sorted(ROOM.rglob("*.py"))


def names_in(source):
    """Names of effects in code: strings, attributes, arguments, imports, functions; not in docstrings and comments.

    A word inside of a sentence, such as "vibration of the drives", is English, unless it has an underscore.
    """
    tree = ast.parse(source)
    told = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        match node:
            case ast.Constant(value=str(text)) if id(node) not in told:
                words = {text, *(word for word in re.findall(r"\w+", text) if "_" in word)}
            case ast.Attribute(attr=name) | ast.keyword(arg=name) | ast.FunctionDef(name=name) | ast.alias(name=name):
                words = {name}
            case _:
                continue
        yield from words & set(CATALOGUE)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOM)))
def test_no_effect_is_known_by_name(path):
    assert not set(names_in(path.read_text()))
