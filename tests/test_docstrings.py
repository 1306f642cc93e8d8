"""Docstrings as tools and readers use them: arguments that parse, shapes and units of arrays, documented errors."""

import ast
import logging
import re
import textwrap
from pathlib import Path

import griffe
import pytest

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs" / "pages" / "api"
ERRORS = {"SetupError", "LogError", "OutputError", "UsageError"}
ARRAY = re.compile(r"\b(Array|ndarray|Float)\b")
SHAPE = re.compile(r"\((\.\.\.|\w+)( [+-] \w+)?(, [\w.]+)*,?\)|\(\)")
UNIT = re.compile(r"\b(N|Nm|rad|m|s|kg|Hz|deg C|nats|precision)\b|standard deviations?")
ANY_UNIT = {
    "ftbias_jax.filtering.gaussian",
    "ftbias_jax.filtering.innovation_regression.widened_inverse",
    "ftbias_jax.filtering.process_models.matrix",
    "ftbias_jax.model.kinematics.screws.skew",
    "ftbias_jax.model.params.as_array",
    "ftbias_jax.model.wrench.tool_wrench.vec",
}
"""Linear algebra: its arguments have the units."""


@pytest.fixture(scope="module")
def package():
    logging.getLogger("griffe").setLevel(logging.CRITICAL)
    return griffe.load("ftbias_jax", search_paths=[str(ROOT)], submodules=True)


def inside(module):
    """Every class, function and method that is defined in a module or below it."""
    for member in module.members.values():
        if member.is_alias:
            continue
        if member.is_module or member.is_class:
            yield from inside(member)
        if member.is_class or member.is_function:
            yield member


def section(member, kind):
    """The section of a docstring as a Google-style parser reads it, or None."""
    parsed = member.docstring.parse("google", warnings=False) if member.docstring else []
    return next((part.value for part in parsed if part.kind.value == kind), None)


def parameters(member):
    return [parameter.name for parameter in member.parameters if parameter.name not in ("self", "cls")]


def told(member):
    return [parameter.name.lstrip("*") for parameter in section(member, "parameters") or []]


def public(package):
    """The functions of the modules on the pages of the API."""
    names = [name for page in sorted(PAGES.glob("*.md")) for name in re.findall(r"^::: (\S+)", page.read_text(), re.M)]
    for name in ("ftbias_jax", *names):
        documented = package.modules_collection[name]
        if documented.is_function:
            yield documented
            continue
        for member in documented.members.values():
            listed = member.name in (documented.exports or ())
            if (listed or not member.is_alias) and member.is_function and not member.name.startswith("_"):
                yield member.final_target if member.is_alias else member


def raised(member):
    """Typed errors that the body itself raises by name."""
    tree = ast.parse(textwrap.dedent(member.source))
    calls = (node.exc.func for node in ast.walk(tree) if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call))
    return {call.id for call in calls if isinstance(call, ast.Name)} & ERRORS


def test_every_argument_section_is_read_as_it_is_meant(package):
    misread = {
        member.path: sorted(set(told(member)) ^ set(parameters(member)))
        for member in inside(package)
        if section(member, "parameters") is not None and set(told(member)) != set(parameters(member))
    }
    assert misread == {}, "unknown or missing arguments"


def test_no_argument_section_is_lost_on_the_parser(package):
    """A heading without an indented list below it is text to the parser."""
    lost = [
        member.path
        for member in inside(package)
        if member.docstring and "Args:" in member.docstring.value and section(member, "parameters") is None
    ]
    assert lost == []


def test_public_functions_with_arrays_tell_shapes_and_units(package):
    functions = list(public(package))
    assert len(functions) > 20
    silent = []
    for member in functions:
        annotations = [str(parameter.annotation) for parameter in member.parameters] + [str(member.returns)]
        text = member.docstring.value if member.docstring else ""
        pure = member.path in ANY_UNIT or member.parent.path in ANY_UNIT
        if any(map(ARRAY.search, annotations)) and not (pure or (SHAPE.search(text) and UNIT.search(text))):
            silent.append(member.path)
    assert silent == []


def test_public_functions_tell_the_errors_they_raise(package):
    silent = {}
    for member in public(package):
        announced = {str(error.annotation) for error in section(member, "raises") or []}
        missing = {name for name in raised(member) if not any(name in words for words in announced)}
        if missing:
            silent[member.path] = missing
    assert silent == {}
