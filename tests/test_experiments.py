"""Experiments take hours, so no test runs them; but the names that they import from the package must exist."""

import ast
import importlib
from importlib.util import find_spec
from pathlib import Path

import pytest

import ftbias_jax

EXPERIMENTS = Path(ftbias_jax.__file__).parents[1] / "experiments"
SCRIPTS = sorted(path.relative_to(EXPERIMENTS) for path in EXPERIMENTS.rglob("*.py"))


def missing(source):
    """Names that a script imports from the package, or looks up in its modules, and that do not exist."""
    tree, modules, lost = ast.parse(source), {}, []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            ours = [alias for alias in node.names if alias.name == ftbias_jax.__name__]
            modules |= {alias.asname or alias.name: ftbias_jax for alias in ours}
        elif isinstance(node, ast.ImportFrom) and node.module.split(".")[0] == ftbias_jax.__name__:
            module = importlib.import_module(node.module)
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                if hasattr(module, "__path__") and find_spec(inner):
                    modules[alias.asname or alias.name] = importlib.import_module(inner)
                elif not hasattr(module, alias.name):
                    lost.append(inner)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            module = modules.get(node.value.id)
            if module is not None and not hasattr(module, node.attr):
                lost.append(f"{module.__name__}.{node.attr}")
    return lost


@pytest.mark.parametrize("script", SCRIPTS, ids=str)
def test_names_are_there(script):
    assert missing((EXPERIMENTS / script).read_text()) == []


def test_a_name_that_is_gone_is_seen():
    source = "import ftbias_jax as ft\nfrom ftbias_jax.cli.commands import demo\nfrom ftbias_jax.setup import lost\n"
    source += "ft.filter_log, ft.gone, demo.SETUP, demo.CENTER\n"
    assert missing(source) == ["ftbias_jax.setup.lost", "ftbias_jax.gone", "ftbias_jax.cli.commands.demo.CENTER"]
