"""The docs agree with the code: generated pages are complete, and lists written by hand lack nothing."""

import importlib.util
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from ftbias_jax.diagnosis.result import VERDICTS
from ftbias_jax.filtering.result import ARRAYS
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
    assert "| `noise_density` | `[0.0002, 1e-05]` | N/s^1.5, Nm/s^1.5 | sigma_Q, noise density of the drift |" in page
    for name, section in SECTIONS.items():
        part = page.split(f"{{ #{name.replace('.', '-')} }}\n")[1].split("\n## ")[0]
        assert all(f"| `{key}` |" in part for key in section.keys)
    assert all(f"| `{robot}` |" in page for robot in BUILT_IN)


def test_the_page_of_the_command_line_has_every_command(hooks):
    page = hooks.command_line_page()
    assert all(f"\n## ftbias {name}\n" in page for name in ("filter", "tune", "diagnose", "calibrate"))
    assert "--hold-out SHARE" in page


def test_the_page_of_results_has_every_array():
    page = (PAGES / "reference" / "results.md").read_text()
    assert [name for name in ARRAYS if f"`{name}`" not in page] == []


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


def test_every_function_that_the_method_names_is_there():
    named = re.findall(r"`([a-z_]+/[a-z_/]+)\.([a-z_]+)`", (PAGES / "model.md").read_text())
    assert len(named) > 30
    for path, function in named:
        module = importlib.import_module(f"ftbias_jax.{path.replace('/', '.')}")
        assert callable(getattr(module, function)), (path, function)


def test_examples_on_the_pages_are_the_scripts_that_are_run():
    """Formatters that know Markdown break the line that includes it, unless its fence is none of theirs."""
    included = {"python": "likelihood.py", "train": "train_the_noise.py", "own_effects": "magnet.py:effect"}
    included |= {"simulators": "train_like_real.py:environment"}
    for page, script in included.items():
        assert f'```{{ .python }}\n--8<-- "examples/{script}"\n```' in (PAGES / "howto" / f"{page}.md").read_text()


@pytest.mark.parametrize("page", ["tutorial.md", "howto/diagnose.md"])
def test_the_tutorial_and_the_guide_know_all_verdicts(page):
    text = (PAGES / page).read_text()
    assert [verdict for verdict in VERDICTS if f"`{verdict}`" not in text] == []
    assert "one of four" not in text


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built as the README describes."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", ROOT / "docs" / "mkdocs.yml", "-d", folder]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "JAX_PLATFORMS": "cpu"}
    built = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    return folder


class Loaded(HTMLParser):
    """Addresses that a browser loads with a page, without following a link."""

    def __init__(self, text):
        super().__init__()
        self.addresses, self.asks_for_stars = [], False
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.asks_for_stars |= given.get("data-md-component") == "source"
        if tag != "a":
            named = [given.get(name) for name in ("src", "href", "data", "poster", "action")]
            sets = [part.split()[0] for part in (given.get("srcset") or "").split(",") if part.strip()]
            self.addresses += [address for address in (*named, *sets) if address]
            self.addresses += styled(given.get("style") or "")


def styled(css):
    """Addresses in a style sheet."""
    return re.findall(r"""(?:url\(|@import)\s*["']?([^"')\s]+)""", css)


def outside(page, addresses, site):
    """Addresses that are no file of the site."""
    files = [(page.parent / unquote(urlsplit(x).path)).resolve() for x in addresses]
    return [
        address
        for address, file in zip(addresses, files, strict=True)
        if not address.startswith(("data:", "#"))
        and (urlsplit(address)[:2] != ("", "") or not file.is_relative_to(site.resolve()) or not file.exists())
    ]


def test_no_page_loads_anything_from_outside_the_folder(site):
    pages = sorted(site.rglob("*.html"))
    assert len(pages) >= len(list(PAGES.rglob("*.md")))
    for page in pages:
        loaded = Loaded(page.read_text())
        assert loaded.addresses
        assert not loaded.asks_for_stars, "the theme's script asks the repository's host for stars"
        assert outside(page, loaded.addresses, site) == [], page
    for sheet in site.rglob("*.css"):
        assert outside(sheet, styled(re.sub(r"/\*.*?\*/", "", sheet.read_text(), flags=re.S)), site) == [], sheet


def test_formulas_are_typeset(site):
    formulas = sum((page.read_text().count("$$") for page in PAGES.rglob("*.md")), 0) // 2
    pages = {page: page.read_text() for page in site.rglob("*.html")}
    assert (
        sum(text.count('<math xmlns="http://www.w3.org/1998/Math/MathML" display="block"') for text in pages.values())
        == formulas
        > 10
    )
    raw = re.compile(r"arithmatex|\\(?:begin|frac|quad|mathrm|left)\b|<merror")
    assert [page for page, text in pages.items() if raw.search(text)] == []


def test_links_of_the_readme_lead_somewhere():
    links = re.findall(r"\]\((?!https?:)([^)#]+)", (ROOT / "README.md").read_text())
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
