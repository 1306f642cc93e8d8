"""MkDocs hooks that generate pages of the site from the tables of the code and convert formulas to MathML.

Generated pages cannot disagree with the code: the setup's keys come from the same table as the parser's checks.
Browsers typeset MathML natively, without a script or a font from the network.
"""

from __future__ import annotations

import html
import importlib
import os
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Literal

import numpy as np

HERE = Path(__file__).parent
MINIMAL: dict[str, dict[str, Any]] = {
    "robot": {"model": "panda"},
    "sensor": {"noise_std": [0.1, 0.004]},
    "tool": {"mass": 0.7, "center_of_mass": [0.0, 0.0, 0.06]},
}
"""Shortest valid setup; its page lists the defaults of the keys that it leaves out."""


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages to the files of the site; called by MkDocs."""
    from mkdocs.structure.files import File

    for path, page in PAGES.items():
        files.append(File.generated(config, path, content=page()))
    return files


def on_page_content(content: str, **_: Any) -> str:
    """Convert the formulas in the HTML of a page to MathML; called by MkDocs."""
    inline, block = (
        r'<span class="arithmatex">\\\((.*?)\\\)</span>',
        r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>',
    )
    content = re.sub(inline, lambda found: _mathml(found[1], "inline"), content, flags=re.DOTALL)
    rows = '<div class="formula">{}</div>'
    return re.sub(block, lambda found: rows.format(_mathml(found[1], "block")), content, flags=re.DOTALL)


def on_post_build(config: Any, **_: Any) -> None:
    """Delete the page for unknown addresses, whose links all start at "/"; called by MkDocs after the build."""
    (Path(config.site_dir) / "404.html").unlink(missing_ok=True)


def _mathml(latex: str, display: Literal["inline", "block"]) -> str:
    """Convert a LaTeX formula with HTML entities to MathML."""
    from latex2mathml.converter import convert

    # The converter knows aligned rows only by the name of the environment that LaTeX uses outside of formulas.
    return convert(" ".join(html.unescape(latex).split()).replace("{aligned}", "{align*}"), display=display)


def effects_page() -> str:
    """Markdown page of all effects of the catalogue, grouped by stage."""
    from ftbias_jax.model.effects.catalogue import CATALOGUE

    stages: dict[str, list[Any]] = {}
    for effect in CATALOGUE.values():
        stages.setdefault(effect.stage, []).append(effect)
    parts = [
        f"# Effects\n\nThe {len(CATALOGUE)} reasons why a real log differs from the model.",
        "`ftbias simulate --effect NAME` adds one to a simulated log, `ftbias diagnose` looks for them, and a section",
        "`[effects.NAME]` in a setup makes every command take one into account. Typical sizes are departures from the",
        "value that does nothing.\n",
    ]
    for stage, effects in stages.items():
        parts.append(f"\n## {stage.capitalize()}\n")
        parts += [_effect(effect) for effect in effects]
    return "\n".join(parts)


def _effect(effect: Any) -> str:
    rows = [
        (
            f"`{p.name}`" + (" (optional)" if p.optional else ""),
            p.unit,
            "×".join("events" if size == -1 else str(size) for size in p.shape) or "1",
            f"{np.min(p.lower):g} to {np.max(p.upper):g}",
            _span(p.scale),
            p.meaning,
        )
        for p in effect.parameters
    ]
    lines = [
        f"### {effect.name}\n",
        f"{_sentence(effect.explanation)}\n",
        f"What to do: {_sentence(effect.remedy)}\n",
        _table(("parameter", "unit", "numbers", "range", "typical", "meaning"), rows),
    ]
    if effect.needs:
        lines.append(f"Needs in the log: {', '.join(effect.needs)}.\n")
    for twin in effect.twins:
        name = "Invisible" if twin.effect == "none" else f"Looks like [{twin.effect}](#{twin.effect})"
        lines.append(f"- {name}{' (exactly)' if twin.exact else ''}: {twin.separate_by}")
    return "\n".join(lines) + "\n"


def _span(scale: Any) -> str:
    sizes = np.unique(np.asarray(scale, float))
    sizes = sizes[sizes > 0]
    return " to ".join(f"{x:g}" for x in dict.fromkeys([sizes.min(), sizes.max()])) if sizes.size else "not fitted"


def setup_page() -> str:
    """Markdown page of all setup keys and all built-in robots."""
    from ftbias_jax.setup.keys.table import SECTIONS
    from ftbias_jax.setup.robots import BUILT_IN, describe_robot

    parts = [
        "# Setup keys\n\nWhat the robot's owner states, in TOML. An unknown or misspelt key is an error that names the",
        "nearest known one. `ftbias setup --schema` prints this table as a JSON Schema, with which editors complete",
        "and check a setup while it is written; `ftbias setup --robot NAME -o setup.toml` writes one to fill in.\n",
    ]
    for name, section in SECTIONS.items():
        rows = [(f"`{key}`", _default(known), known.unit, known.meaning) for key, known in section.keys.items()]
        rows += [("any other", "", "", section.further)] if section.further else []
        title = f"[[{name}]]" if name == "robot.joints" else f"[{name}]"
        parts += [
            f"## `{title}` {{ #{name.replace('.', '-')} }}\n",
            f"{section.about}\n",
            _table(("key", "default", "unit", "meaning"), rows),
        ]
    parts.append("## [effects.NAME]\n\nParameters of an effect, as on the page of [effects](effects.md).\n")
    parts.append(
        "## Built-in robots { #robots }\n\nFrom the manufacturers' published parameters; the older entries have the "
        "joints' limits, those from a Denavit-Hartenberg table have none.\n"
    )
    parts.append(
        _table(("`robot.model`", "robot and flange"), [(f"`{name}`", describe_robot(name)) for name in BUILT_IN])
    )
    parts.append("## The shortest setup, written out\n\nWith every default, as `ftbias` writes it:\n")
    parts.append(f"```toml\n{_minimal_text()}```\n")
    return "\n".join(parts)


def _minimal_text() -> str:
    from ftbias_jax.setup import dump_setup, parse_setup

    return dump_setup(parse_setup(MINIMAL))


def _default(key: Any) -> str:
    from ftbias_jax.setup.dump import toml_value

    if key.required:
        return "required"
    if key.default is None:
        return str(key.absent)
    value = key.default
    if isinstance(value, tuple) and len(value) != 2 and len(set(value)) == 1:
        value = value[0]
    return f"`{toml_value(value)}`"


def command_line_page() -> str:
    """Markdown page with the ``--help`` output of every command."""
    os.environ["COLUMNS"], os.environ["NO_COLOR"] = "100", "1"
    from ftbias_jax.cli.main import build_parser

    parts = [
        "# Command line\n\nEvery command answers `--help`. The [exit codes](exit-codes.md) are the same for all.\n"
    ]
    parts += [f"## {name}\n\n```text\n{text}```\n" for name, text in _helps("ftbias", build_parser())]
    return "\n".join(parts)


def _helps(name: str, parser: Any) -> Iterable[tuple[str, str]]:
    yield name, parser.format_help()
    for action in parser._actions:
        if hasattr(action, "add_parser"):
            for word, below in action.choices.items():
                yield from _helps(f"{name} {word}", below)


def verbs_page() -> str:
    """Markdown page of all names in ``ftbias_jax``, with details of those that no other page documents."""
    import ftbias_jax

    elsewhere = _documented()
    rows, rest = [], []
    for name in getattr(ftbias_jax, "__all__", ()):
        thing = getattr(ftbias_jax, name)
        own = getattr(thing, "__qualname__", name)  # a constant has no __qualname__
        path = elsewhere.get(id(thing), f"ftbias_jax.{ftbias_jax._MODULE_OF[name]}.{own}")
        summary = (thing.__doc__ or "").strip().splitlines()[0]
        rows.append((f"[`ft.{name}`][{path}]", summary))
        if id(thing) not in elsewhere and not name.isupper():  # constants are documented on their module's page
            rest.append(f"::: {path}\n    options:\n      heading: ft.{name}\n      toc_label: {name}\n")
    functions_first = sorted(rows, key=lambda row: row[0][len("[`ft.")].isupper())
    return "\n".join(
        [
            "# Verbs\n\n```python\nimport ftbias_jax as ft\n```\n",
            "Importing costs milliseconds, because names are imported when they are first used. The other pages of",
            "this section have what lies below.\n",
            _table(("name", "what it is or does"), functions_first),
            *rest,
        ]
    )


def _documented() -> dict[int, str]:
    """Map the id of each object that another API page documents to its import path."""
    found = {}
    for page in sorted((HERE / "pages" / "api").glob("*.md")):
        for path in re.findall(r"^::: (\S+)", page.read_text(), re.MULTILINE):
            try:
                module = importlib.import_module(path)
            except ModuleNotFoundError:  # a member
                above, _, name = path.rpartition(".")
                found[id(getattr(importlib.import_module(above), name))] = path
                continue
            for name, thing in vars(module).items():
                if name in getattr(module, "__all__", ()) or getattr(thing, "__module__", "") == path:
                    found[id(thing)] = f"{path}.{name}"
    return found


def _sentence(words: str) -> str:
    return words[0].upper() + words[1:].rstrip(".") + "."


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    lines = [list(head)]
    lines.append(["---"] * len(lines[0]))
    lines += [[str(cell).replace("|", "\\|") for cell in row] for row in rows]
    return "\n".join("| " + " | ".join(row) + " |" for row in lines) + "\n"


PAGES: dict[str, Callable[[], str]] = {
    "reference/effects.md": effects_page,
    "reference/setup.md": setup_page,
    "reference/command-line.md": command_line_page,
    "api/index.md": verbs_page,
}
"""Path of a generated page in the site -> the function that returns its Markdown."""
