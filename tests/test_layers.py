"""Imports go downward only, the light modules stay light, and no import touches a flag of JAX."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import ftbias_jax

PACKAGE = Path(ftbias_jax.__file__).parent

# Lowest first. Units on one line are on one level: they import lower ones, never each other.
FLOORS = (
    "errors files types",
    "runtime setup",
    "io",
    "check model",
    "filtering",
    "calibration diagnosis",
    "commissioning fleet planning simulators",
    "cli",
)
FLOOR = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms.split()}
MOST_LINES, MOST_MODULES, MOST_ROOMS, MOST_FLOORS = 300, 14, 16, 8


def unit_of(path):
    """The module or folder at the top level of the package to which a source file belongs."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def source_files():
    doors = {PACKAGE / "__init__.py", PACKAGE / "__main__.py"}
    return sorted(path for path in PACKAGE.rglob("*.py") if path not in doors)


def imported_names(nodes):
    """Full names of modules, or of names in modules, that the imports among nodes of a syntax tree name."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports inside the package are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def imported_units(tree):
    """Units of this package that a syntax tree imports, anywhere in it, under a condition or in a function."""
    for name in imported_names(ast.walk(tree)):
        package, *rest = [*name.split("."), ""]
        if package == PACKAGE.name and rest[0] not in ("", "__version__"):
            yield rest[0]


def at_run_time(node):
    """The nodes of a syntax tree except those that only type checkers read."""
    yield node
    for child in ast.iter_child_nodes(node):
        if not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
            yield from at_run_time(child)


@pytest.mark.parametrize("path", source_files(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_downward(path):
    room = unit_of(path)
    assert room in FLOOR, f"{room} has no floor: give it one in FLOORS"
    others = set(imported_units(ast.parse(path.read_text()))) - {room}
    upward = {other for other in others if FLOOR.get(other, len(FLOORS)) >= FLOOR[room]}
    assert not upward, f"{room} imports {sorted(upward)}, which are not below it"


def test_the_house_is_small_enough_to_find_ones_way():
    assert len(FLOOR) <= MOST_ROOMS
    assert len(FLOORS) <= MOST_FLOORS
    assert {unit_of(path) for path in source_files()} == set(FLOOR)
    for folder in {path.parent for path in source_files()}:
        modules = list(folder.glob("*.py"))
        assert len(modules) <= MOST_MODULES, f"{folder.relative_to(PACKAGE)} has {len(modules)} modules"


@pytest.mark.parametrize("path", source_files(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_modules_are_short(path):
    assert len(path.read_text().splitlines()) <= MOST_LINES


def module_imports(trees):
    """Module -> the modules that it imports, on its own import or later, in a function.

    Args:
        trees: module -> its syntax tree.
    """
    graph = {}
    for module, tree in trees.items():
        graph[module] = set()
        for name in imported_names(at_run_time(tree)):
            while name and name not in trees:
                name = name.rpartition(".")[0]
            graph[module] |= {name} & trees.keys() - {module}
    return graph


def circle_in(graph):
    """The modules of a circular import, the first one at both ends; empty if there is none."""
    done = set()

    def visit(module, path):
        if module in path:
            return [*path[path.index(module) :], module]
        found = []
        if module not in done:
            found = next(filter(None, (visit(other, [*path, module]) for other in sorted(graph[module]))), [])
            done.add(module)
        return found

    return next(filter(None, (visit(module, []) for module in graph)), [])


def test_there_is_no_import_circle():
    paths = {".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts): path for path in source_files()}
    trees = {name.removesuffix(".__init__"): ast.parse(path.read_text()) for name, path in paths.items()}
    assert not circle_in(module_imports(trees))


@pytest.mark.parametrize(
    ("back", "circle"),
    [
        ("from room.a import A", ["room.a", "room.b", "room.a"]),
        ("def late():\n    import room.a", ["room.a", "room.b", "room.a"]),
        ("if TYPE_CHECKING:\n    from room.a import A", []),
    ],
)
def test_a_circle_would_be_seen(back, circle):
    """Late imports count; imports for type checkers do not."""
    assert circle_in(module_imports({"room.a": ast.parse("from room import b"), "room.b": ast.parse(back)})) == circle


def test_the_package_itself_imports_its_modules_for_type_checkers_only():
    assert not list(imported_units(ast.parse((PACKAGE / "__init__.py").read_text())))


def test_an_upward_import_would_be_seen():
    """All forms of an import statement are recognised."""
    source = """
import ftbias_jax.cli.main
from ftbias_jax import filtering
if True:
    from ftbias_jax.diagnosis.shrink import shrink
def late():
    from ftbias_jax.io.write import mcap
"""
    assert set(imported_units(ast.parse(source))) == {"cli", "filtering", "diagnosis", "io"}


def output_of(program):
    environment = {key: value for key, value in os.environ.items() if not key.startswith("JAX_")}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.parametrize(
    "module", ["ftbias_jax", "ftbias_jax.setup", "ftbias_jax.io", "ftbias_jax.check.check_setup", "ftbias_jax.cli.main"]
)
def test_reading_arguments_and_checking_setups_does_not_import_jax(module):
    assert output_of(f"import sys, {module}; print('jax' in sys.modules)") == ["False"]


def test_importing_the_package_imports_neither_jax_nor_numpy_nor_its_rooms():
    heavy = {"jax", "numpy", "ftbias_jax.setup", "ftbias_jax.io"}
    assert output_of(f"import sys, ftbias_jax; print(sorted({heavy} & set(sys.modules)))") == ["[]"]


def test_importing_everything_leaves_the_flags_of_jax_alone():
    modules = [".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts) for path in source_files()]
    assert output_of(f"""
import importlib, jax
before = dict(jax.config.values)
for module in {modules}:
    importlib.import_module(module.removesuffix(".__init__"))
print(jax.config.jax_enable_x64, dict(jax.config.values) == before)
""") == ["False", "True"]
