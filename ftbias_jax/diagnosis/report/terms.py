"""The part of the report about what is not in the catalogue, and what all of its parts are made of."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from ftbias_jax.diagnosis.report.plots import plot_term
from ftbias_jax.diagnosis.report.svg import escape
from ftbias_jax.diagnosis.report.tables import term_numbers
from ftbias_jax.diagnosis.result import FoundTerm

PRINTED = {r" \+- ": " ± ", r"(?<=[a-z])\^2\b(?!\.)": "²", r"(?<=[a-z])\^3\b": "³", r"\bdeg C\b": "°C"}
"""What is written as plain text -> the same in print."""


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table whose first column names the row; empty without rows."""
    lines = [
        f'<tr><th scope="row">{typeset(first)}</th>{"".join(f"<td>{typeset(cell)}</td>" for cell in rest)}</tr>'
        for first, *rest in rows
    ]
    columns = "".join(f'<th scope="col">{escape(name)}</th>' for name in head)
    table = f"<table><thead><tr>{columns}</tr></thead><tbody>{''.join(lines)}</tbody></table>"
    return f'<div class="scroll" tabindex="0">{table}</div>' if lines else ""


def capital(text: str) -> str:
    """With a capital letter and a full stop."""
    return f"{text[:1].upper()}{text[1:].removesuffix('.')}." if text else ""


def typeset(text: str) -> str:
    """What terminals of any encoding can show, as HTML: signs and powers of units as they are printed."""
    for plain, printed in PRINTED.items():
        text = re.sub(plain, printed, text)
    return escape(text)


def show_terms(terms: Sequence[FoundTerm]) -> str:
    """What no effect of the catalogue explains, described by its drive."""
    parts = []
    for number, term in enumerate(terms):
        parts.append(f"<h3>{typeset(capital(term.text))}</h3>")
        figure = ""
        if term.curve is not None:
            caption = "Orange: what was left of the reading; blue: the term. Markers: means with standard errors."
            plot = plot_term(term.curve, f"term-{number}")
            figure = f"<figure>{plot}<figcaption>{caption}</figcaption></figure>"
        table = html_table(("number", "value ± standard error"), term_numbers(term))
        words = [("Looks like", ", ".join(term.resembles)), ("What to check", term.check)]
        words += [(f"Could as well be {d}", how) for d, how in zip(term.equivalent_to, term.separate_by, strict=True)]
        items = "".join(f"<li><b>{escape(head)}</b>: {escape(text)}.</li>" for head, text in words if text)
        parts.append(f"<div class='pair'>{figure}<div>{table}<ul>{items}</ul></div></div>")
    return "".join(parts)
