"""Score of a set, as numbers for programs and as tables for readers."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from validation import description_tables
from validation.labels import Label
from validation.parameters import Compared, compare
from validation.rules import (
    ORACLE_SHRINK,
    SHRINK_MARGIN,
    Share,
    called,
    has_mean_gap,
    is_named,
    is_right,
    left_out,
    named,
    names_only_twins,
    share,
)

SCHEMA = 1
Scored = Mapping[str, tuple[Label, dict[str, Any]]]
"""Name of a log -> its label and its diagnosis."""
HONEST = ("unknown", "described", "partly_explained", "twin")


def shares(scored: Scored) -> dict[str, Share]:
    """Return the main score: criterion -> share of the logs that meet it."""
    of = _by_group(scored)
    shrinks = [
        said["gap"]["shrink"] >= ORACLE_SHRINK - SHRINK_MARGIN
        for label, said in scored.values()
        if is_right(label, said) and has_mean_gap(label)
    ]
    compared = [one for label, said in scored.values() if is_right(label, said) for one in compare(label, said)]
    return {
        "right cause first": share(is_right(*pair) for pair in of["single"]),
        "false alarms on none": share(not is_right(*pair) for pair in of["none"]),
        "unlisted: honest": share(is_right(*pair) for pair in of["unlisted"]),
        "unlisted: confidently misnamed": share(said["verdict"] == "explained" for _, said in of["unlisted"]),
        "pairs: both named": share(is_right(*pair) for pair in of["pair"]),
        "pairs: at least one named": share(any(is_named(*pair)) for pair in of["pair"]),
        "shrink within 0.05 of the oracle's": share(shrinks),
        "parameters: truth within 3 sigma, all numbers": share(bool(one.inside.all()) for one in compared),
        "parameters: truth within 3 sigma, each number": share(bool(x) for one in compared for x in one.inside),
        "faint, not counted: right": share(is_right(*pair) for pair in of["faint"]),
    }


def by_effect(scored: Scored) -> dict[str, Share]:
    """Map each single or unlisted effect to the share of right diagnoses."""
    found: dict[str, list[bool]] = defaultdict(list)
    for label, said in scored.values():
        if label.group in ("single", "unlisted"):
            found[f"unlisted: {label.name}" if label.group == "unlisted" else label.name].append(is_right(label, said))
    return {name: share(found[name]) for name in sorted(found, key=lambda name: (":" in name, name))}


def confusion(scored: Scored) -> Counter[tuple[str, str]]:
    """Count the pairs (true effects, reported effects or verdict) over all diagnoses."""
    return Counter((label.name, called(said)) for label, said in scored.values())


def parameter_table(scored: Scored) -> dict[tuple[str, str], dict[str, Any]]:
    """(effect, parameter) -> number of diagnoses, median |error| in its unit and in standard errors, share covered."""
    found: dict[tuple[str, str], list[Compared]] = defaultdict(list)
    for label, said in scored.values():
        for one in compare(label, said):
            found[one.effect, one.parameter].append(one)
    return {
        key: {
            "diagnoses": len(found[key]),
            "median_error": _median(np.concatenate([np.abs(one.error) for one in found[key]])),
            "median_error_in_stderr": _median(np.concatenate([np.abs(one.error) / one.stderr for one in found[key]])),
            "inside": share(bool(one.inside.all()) for one in found[key]).plain(),
        }
        for key in sorted(found)
    }


def withheld_content(scored: Scored) -> dict[str, Any]:
    """Return the score of the protocol ``withheld`` as numbers for programs."""
    kinds = description_tables.judged(scored)
    return {
        "schema": SCHEMA,
        "protocol": "withheld",
        "logs": len(scored),
        "score": {name: counted.plain() for name, counted in shares(scored).items()},
        "by_effect": {name: counted.plain() for name, counted in by_effect(scored).items()},
        "confusion": [
            {"true": true, "called": said, "logs": n} for (true, said), n in sorted(confusion(scored).items())
        ],
        "parameters": [
            {"effect": effect, "parameter": name, **row} for (effect, name), row in parameter_table(scored).items()
        ],
        "seconds": _seconds(scored),
        "rows": [_row(name, label, said) | {"right": is_right(label, said)} for name, (label, said) in scored.items()],
        **({"unlisted_kinds": description_tables.content(kinds)} if kinds else {}),
    }


def withheld_text(scored: Scored) -> str:
    """Return the score of ``withheld`` as tables, with 95 % confidence intervals (Wilson) in brackets."""
    kinds = description_tables.judged(scored)
    if kinds and len(kinds) == len(scored):
        return "\n".join([description_tables.text(kinds), "", _seconds_words(scored)])
    lines = [f"{len(scored)} logs; shares with 95 % confidence intervals", ""]
    lines += [f"{name:46s}{counted}" for name, counted in shares(scored).items()]
    lines += ["", "right, by effect"]
    lines += [f"  {name:44s}{counted}" for name, counted in by_effect(scored).items()]
    wrong = Counter((label.name, called(said)) for label, said in scored.values() if not is_right(label, said))
    lines += ["", "wrong: what it was, what it was called, logs"] if wrong else []
    lines += [f"  {true:36s} {said:44s} {n:3d}" for (true, said), n in wrong.most_common()]
    table = parameter_table(scored)
    head = f"  {'parameter':36s}{'logs':>5s}{'median error':>14s}{'in std errors':>15s}   truth within 3 sigma"
    lines += ["", "parameters of correctly named effects", head] if table else []
    for (effect, name), row in table.items():
        inside = Share(row["inside"]["hits"], row["inside"]["of"])
        errors = f"{_number(row['median_error']):>14s}{_number(row['median_error_in_stderr']):>15s}"
        lines.append(f"  {f'{effect}.{name}':36s}{row['diagnoses']:5d}{errors}   {inside}")
    lines += ["", description_tables.text(kinds)] if kinds else []
    return "\n".join([*lines, "", _seconds_words(scored)])


def left_out_content(scored: Scored) -> dict[str, Any]:
    """Return the score of the protocol ``leave_one_out`` as numbers for programs."""
    rows = [_row(name, label, said) | {"outcome": left_out(label.name, said)} for name, (label, said) in scored.items()]
    return {
        "schema": SCHEMA,
        "protocol": "leave_one_out",
        "logs": len(scored),
        "score": {name: counted.plain() for name, counted in _left_out_shares(scored).items()},
        "by_effect": {name: dict(row) for name, row in sorted(_outcomes(scored).items())},
        "confusion": [
            {"left_out": true, "called": said, "logs": n} for (true, said), n in sorted(confusion(scored).items())
        ],
        "seconds": _seconds(scored),
        "rows": rows,
    }


def left_out_text(scored: Scored) -> str:
    """Return the score of the protocol ``leave_one_out`` as tables."""
    outcomes = ("unknown", "described", "partly_explained", "twin", "none", "wrong", "failed")
    lines = [f"{len(scored)} logs, the true effect left out; shares with 95 % confidence intervals", ""]
    lines += [f"{name:46s}{counted}" for name, counted in _left_out_shares(scored).items()]
    lines += ["", f"{'left out':20s}" + "".join(f"{outcome:>18s}" for outcome in outcomes)]
    lines += [
        f"{name:20s}" + "".join(f"{row[outcome]:18d}" for outcome in outcomes)
        for name, row in sorted(_outcomes(scored).items())
    ]
    wrong = Counter(
        (label.name, called(said)) for label, said in scored.values() if left_out(label.name, said) == "wrong"
    )
    lines += ["", "confident wrong names: what it was, what it was called, logs"] if wrong else []
    lines += [f"  {true:36s} {said:44s} {n:3d}" for (true, said), n in wrong.most_common()]
    return "\n".join([*lines, "", _seconds_words(scored)])


def _outcomes(scored: Scored) -> dict[str, Counter[str]]:
    """Map each effect that was left out to the counts of its outcomes."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for label, said in scored.values():
        counts[label.name][left_out(label.name, said)] += 1
    return counts


def _left_out_shares(scored: Scored) -> dict[str, Share]:
    outcomes = [left_out(label.name, said) for label, said in scored.values()]
    return {
        "unknown, described, partly explained or a twin": share(outcome in HONEST for outcome in outcomes),
        "confident wrong name": share(outcome == "wrong" for outcome in outcomes),
        "wrong name among the causes of any verdict": share(
            not names_only_twins(label.name, said) for label, said in scored.values()
        ),
        "no gap seen": share(outcome == "none" for outcome in outcomes),
    }


def _by_group(scored: Scored) -> dict[str, list[tuple[Label, dict[str, Any]]]]:
    found: dict[str, list[tuple[Label, dict[str, Any]]]] = defaultdict(list)
    for pair in scored.values():
        found[pair[0].group].append(pair)
    return found


def _row(name: str, label: Label, said: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "log": name,
        "true": list(label.effects),
        "form": label.forms,
        "group": label.group,
        "gap_sigmas": label.gap_sigmas,
        "verdict": said["verdict"],
        "called": [sorted(names) for names in named(said)],
        "shrink": said["gap"]["shrink"],
        "outside": [f"{one.effect}.{one.parameter}" for one in compare(label, said) if not one.inside.all()],
        "seconds": said.get("seconds"),
    }


def _seconds(scored: Scored) -> dict[str, float | None]:
    taken = [said["seconds"] for _, said in scored.values() if said.get("seconds") is not None]
    return {"median": _median(taken), "longest": max(taken, default=None)}


def _seconds_words(scored: Scored) -> str:
    seconds = _seconds(scored)
    return f"seconds a log: median {_number(seconds['median'])}, longest {_number(seconds['longest'])}"


def _median(values: Iterable[float]) -> float | None:
    listed = list(values)
    return float(np.median(listed)) if listed else None


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
