"""Imports go downward only, the light modules stay light, and no import touches a flag of JAX."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import ftbias_jax

PACKAGE = Path(ftbias_jax.__file__).parent

# Lowest first. A module imports only what stands before it: in a lower layer, or to its left in its own.
# A folder counts as one module.
LAYERS = (
    "errors types setup_types rotations robots setup_fields urdf urdf_robot setup_pose setup_parse setup_dump setup",
    "atomic npz_file progress",
    "small_matrices whole_loops distributed gaussian screws arm_batch free_body newton ascent inertia stacks",
    "noise wrench wrench_piece wrench_slopes wrench_batch filter_step recursion backward parallel",
    "joint_filter bias_filter effects",
    "pipeline staged trajectories simulate",
    "smooth likelihood consistency filtered batch summary excitation",
    "regression tune identify",
    "gap",
    "results plot report_svg report_plots report logs writers compilation",
    "filter_file archive processes workers",
    "blind",
    "commands option_kinds cli",
)
RANK = {name: rank for rank, name in enumerate(" ".join(LAYERS).split())}


def unit_of(path):
    """The module or folder at the top of the package that a source file belongs to."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def source_files():
    return sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def imported_units(tree):
    """Modules of this package that a syntax tree imports, anywhere in it, under a condition or in a function."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports inside the package are absolute"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            package, *rest = [*name.split("."), ""]
            if package == PACKAGE.name and rest[0] not in ("", "__version__"):
                yield rest[0]


@pytest.mark.parametrize("path", source_files(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_downward(path):
    unit = unit_of(path)
    assert unit in RANK, f"{unit} has no layer: give it a place in LAYERS"
    tree = ast.parse(path.read_text())
    upward = {other for other in imported_units(tree) if other != unit and RANK.get(other, len(RANK)) > RANK[unit]}
    assert not upward, f"{unit} imports {sorted(upward)}, which stand above it"


def test_the_package_itself_imports_none_of_its_modules():
    assert not list(imported_units(ast.parse((PACKAGE / "__init__.py").read_text())))


def test_an_upward_import_would_be_seen():
    """In all its spellings."""
    source = """
import ftbias_jax.cli
from ftbias_jax import pipeline
if True:
    from ftbias_jax.gap.shrink import shrink
def late():
    from ftbias_jax.report import write
"""
    assert set(imported_units(ast.parse(source))) == {"cli", "pipeline", "gap", "report"}


def output_of(program):
    environment = {key: value for key, value in os.environ.items() if not key.startswith("JAX_")}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.parametrize("module", ["ftbias_jax", "ftbias_jax.setup", "ftbias_jax.logs", "ftbias_jax.cli"])
def test_reading_arguments_and_setups_does_not_import_jax(module):
    assert output_of(f"import sys, {module}; print('jax' in sys.modules)") == ["False"]


def test_importing_everything_leaves_the_flags_of_jax_alone():
    modules = [".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts) for path in source_files()]
    assert output_of(f"""
import importlib, jax
before = dict(jax.config.values)
for module in {modules}:
    importlib.import_module(module.removesuffix(".__init__"))
print(jax.config.jax_enable_x64, dict(jax.config.values) == before)
""") == ["False", "True"]
