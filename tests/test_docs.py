"""The docs say what the code does: generated pages are whole, and lists that are written by hand lack nothing."""

import importlib.util
import re
from pathlib import Path

import pytest

from ftbias_jax.filtering.result import Filtered
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.setup.keys.table import SECTIONS
from ftbias_jax.setup.robots import BUILT_IN

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs" / "pages"


@pytest.fixture(scope="module")
def hooks():
    spec = importlib.util.spec_from_file_location("docs_hooks", ROOT / "docs" / "hooks.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_of_effects_has_every_effect_and_parameter(hooks):
    page = hooks.effects_page()
    for name, effect in CATALOGUE.items():
        part = page.split(f"\n### {name}\n")[1].split("\n### ")[0]
        assert all(f"| `{parameter.name}`" in part for parameter in effect.parameters)


def test_the_page_of_the_setup_has_every_key_and_robot(hooks):
    page = hooks.setup_page()
    assert "| `noise_density` | `[0.0002, 1e-05]` | N/s^1.5, Nm/s^1.5 | sigma_Q, how fast the drift changes |" in page
    for name, section in SECTIONS.items():
        part = page.split(f"{{ #{name.replace('.', '-')} }}\n")[1].split("\n## ")[0]
        assert all(f"| `{key}` |" in part for key in section.keys)
    assert all(f"| `{robot}` |" in page for robot in BUILT_IN)


def test_the_page_of_the_command_line_has_every_command(hooks):
    page = hooks.command_line_page()
    assert all(f"\n## ftbias {name}\n" in page for name in ("filter", "tune", "diagnose", "validate make"))
    assert "--hold-out SHARE" in page


def test_the_page_of_results_has_every_array():
    page = (PAGES / "reference" / "results.md").read_text()
    assert [name for name in Filtered._fields if f"`{name}`" not in page] == []


def test_all_15_errata_are_told_with_their_tests():
    page = (PAGES / "errata.md").read_text()
    assert re.findall(r"^### (\d+)\.", page, re.MULTILINE) == [str(number) for number in range(1, 16)]
    tests = "\n".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    defined = set(re.findall(r"def (test_erratum_\d\d_\w+)", tests))
    assert set(re.findall(r"`(test_erratum_\d\d_\w+)`", page)) == defined


def test_every_page_is_in_the_navigation(hooks):
    text = (ROOT / "docs" / "mkdocs.yml").read_text()
    there = {str(path.relative_to(PAGES)) for path in PAGES.rglob("*.md")} | set(hooks.PAGES)
    assert set(re.findall(r": (\S+\.md)$", text, re.MULTILINE)) == there


def test_the_example_on_the_page_of_python_is_the_script_that_is_run():
    """Formatters that know Markdown break the line that includes it, unless its fence is none of theirs."""
    assert '```{ .python }\n--8<-- "examples/likelihood.py"\n```' in (PAGES / "howto" / "python.md").read_text()


def test_links_of_the_readme_lead_somewhere():
    links = re.findall(r"\]\((?!https?:)([^)#]+)", (ROOT / "README.md").read_text())
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
