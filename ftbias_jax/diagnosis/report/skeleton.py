"""What all pages are made of: a head that loads nothing, a header, sections."""

from __future__ import annotations

from importlib import resources

from ftbias_jax.diagnosis.report.interactive import policy
from ftbias_jax.diagnosis.report.svg import escape


def section(title: str, content: str) -> str:
    """A part of the page, or nothing where there is nothing to say.

    Args:
        title: any text.
        content: HTML.
    """
    return f"<section><h2>{escape(title)}</h2>{content}</section>\n" if content else ""


def whole_page(title: str, body: str, runs: str = "", style: str = "") -> str:
    """One HTML file that needs nothing else: no network, no fonts, and no script but its own.

    Args:
        title: any text.
        body: HTML of the header and the sections.
        runs: the script; "" = none.
        style: CSS after that of all pages.
    """
    common = resources.files("ftbias_jax.diagnosis.report").joinpath("report.css").read_text(encoding="utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy(runs)}">'
        '<meta name="generator" content="ftbias_jax">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<title>{escape(title)}</title><style>{common}{style}</style></head>\n"
        f"<body><main>{body}</main>{f'<script>{runs}</script>' if runs else ''}</body></html>\n"
    )
