"""Every number that decides a verdict is in one module, states the reason for its value, and is used."""

import ast
import re
from pathlib import Path

import pytest

import ftbias_jax.diagnosis
from ftbias_jax.diagnosis import thresholds

ROOM = Path(ftbias_jax.diagnosis.__file__).parent
SOURCE = Path(thresholds.__file__).read_text()
REASONS = re.compile(r"\[(noise|owner|physics|dev)\]")
FILES = sorted(path for path in ROOM.rglob("*.py") if path.name != "thresholds.py")

# Modules whose numbers decide no verdict: reported places and forms, solvers, the clock of a grid.
ELSEWHERE = {
    "check_effects.py": "whether code of the caller's is in order",
    "report": "what is drawn and printed",
    "regression/evaluate.py": "the step of a derivative",
    "regression/fit.py": "when a solver has converged",
    "regression/score_test.py": "what single precision can tell",
    "terms/fit_terms.py": "when a solver has converged",
    "terms/found.py": "how numbers are told",
    "proposals/searched.py": "how starts are spread",
    "proposals/pulls.py": "how starts are spread",
    "terms/grid.py": "which terms a robot with so many joints can have",
    "terms/phrases.py": "how numbers are told",
    "terms/spectra.py": "lengths of spectra",
    "samples/exact.py": "levels that a line needs; a fourth of a step",
    "samples/growth.py": "which tenth",
    "samples/jitter.py": "which windows are slow; when a solver has converged",
    "samples/noise.py": "lengths of windows; when a line is broad",
    "samples/read.py": "half of a count",
    "samples/spikes.py": "lengths of windows",
    "samples/variance_fit.py": "when a solver has converged; folds",
    "terms/dictionary.py": "three axes",
}
SMALL = (-1, 0, 1, 2)


def constants():
    """Name -> docstring of the statement that defines it."""
    body = ast.parse(SOURCE).body
    for node, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.Assign):
            told = after.value.value if isinstance(after, ast.Expr) else ""
            for name in ast.walk(node.targets[0]):
                if isinstance(name, ast.Name):
                    yield name.id, told


@pytest.mark.parametrize(("name", "told"), list(constants()))
def test_each_has_a_meaning_and_a_reason(name, told):
    assert REASONS.search(told), f"{name}: say why, by one of the words of the module"
    assert len(REASONS.sub("", told).split()) > 2
    assert isinstance(getattr(thresholds, name), int | float)


def test_each_is_used():
    used = set()
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module == thresholds.__name__:
                used |= {alias.name for alias in node.names}  # the linter checks that imports are used
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "thresholds":
                used.add(node.attr)
    assert used == {name for name, _ in constants()}


def numbers_that_decide(source):
    """Comparisons with a number that is literal, or defined in the same module."""
    tree = ast.parse(source)
    own = {
        name.id
        for node in tree.body
        if isinstance(node, ast.Assign) and _is_number(node.value)
        for name in ast.walk(node.targets[0])
        if isinstance(name, ast.Name)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            for part in ast.walk(node):
                literal = isinstance(part, ast.Constant) and _is_number(part) and part.value not in SMALL
                if literal or (isinstance(part, ast.Name) and part.id in own):
                    yield ast.unparse(node)


def _is_number(node):
    values = node.elts if isinstance(node, ast.Tuple) else [node]
    return all(
        isinstance(value, ast.Constant) and isinstance(value.value, int | float) and not isinstance(value.value, bool)
        for value in values
    )


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOM)))
def test_no_number_decides_elsewhere(path):
    place = str(path.relative_to(ROOM))
    if not {place, path.parent.name} & set(ELSEWHERE):
        assert not list(numbers_that_decide(path.read_text()))


@pytest.mark.parametrize("place", [place for place in ELSEWHERE if place.endswith(".py")])
def test_every_exception_is_needed(place):
    assert list(numbers_that_decide((ROOM / place).read_text()))
