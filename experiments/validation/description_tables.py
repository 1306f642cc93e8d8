"""Score of the withheld kinds by gap size and by kind: as numbers for programs and as tables for readers."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from validation.descriptions import Judged, judge
from validation.labels import Label
from validation.rules import Share, share

COUNTED = 0.5
"""Gap in noise sigmas from which a log is counted; fainter logs are only listed."""
SIZES = ((0.0, 0.5), (0.5, 1.0), (1.0, 3.0), (3.0, float("inf")))
"""Ranges (from, to) of the gap in noise sigmas by which the logs are grouped."""
SAME_SHRINK = 0.1
"""Largest loss of shrink on the second log for which the shrink counts as holding there."""
ROWS: Mapping[str, Callable[[Sequence[Judged]], Share]] = {
    "right drive first": lambda logs: share(one.right for one in logs),
    "right or equivalent by physics": lambda logs: share(one.equivalent for one in logs),
    "right or declared equivalent": lambda logs: share(one.claimed for one in logs),
    "right drive among the terms": lambda logs: share(one.anywhere for one in logs),
    "wrong catalogue name among the causes": lambda logs: share(bool(one.wrong) for one in logs),
    "catalogue name of nearly the same": lambda logs: share(bool(one.nearly) for one in logs),
    "confidently misnamed (explained)": lambda logs: share(one.verdict == "explained" for one in logs),
    "described": lambda logs: share(one.verdict == "described" for one in logs),
    "no gap seen": lambda logs: share(one.verdict == "none" for one in logs),
    "coefficients: truth within 3 sigma": lambda logs: share(
        bool(x) for one in logs for number in one.coefficients for x in number.inside
    ),
}


def judged(scored: Mapping[str, tuple[Label, Mapping[str, Any]]]) -> dict[str, Judged]:
    """Return the judged logs of withheld kinds by name; other logs are omitted."""
    return {name: judge(label, said) for name, (label, said) in scored.items() if label.withheld is not None}


def content(logs: Mapping[str, Judged]) -> dict[str, Any]:
    """Return the score of the withheld kinds as numbers for programs."""
    return {
        "counted_from_sigmas": COUNTED,
        "counted": _block(counted(logs.values())),
        "by_size": [
            {"from_sigmas": low, "to_sigmas": high if np.isfinite(high) else None, **_block(group)}
            for low, high, group in _sizes(logs.values())
        ],
        "by_kind": {name: _block(group) for name, group in _kinds(logs.values()).items()},
        "rows": [{"log": name, **_row(one)} for name, one in logs.items()],
    }


def counted(logs: Iterable[Judged]) -> list[Judged]:
    """Return the logs with a gap of at least COUNTED noise sigmas."""
    return [one for one in logs if one.gap_sigmas >= COUNTED]


def shrinks(logs: Iterable[Judged]) -> dict[str, float | None]:
    """Medians over the logs with a mean gap: held-out shrink, the oracle's shrink, and the shrink on the second log."""
    of_mean = [one for one in logs if one.of_mean]
    pairs = [(one.shrink, one.second) for one in of_mean if one.second is not None]
    return {
        "shrink": _median([one.shrink for one in of_mean]),
        "oracle": _median([one.truth.oracle_shrink for one in of_mean]),
        "of_the_oracle": _median([one.shrink / max(one.truth.oracle_shrink or 0.0, 1e-6) for one in of_mean]),
        "second_log": _median([second for _, second in pairs]),
        "lost_on_second_log": _median([first - second for first, second in pairs]),
    }


def text(logs: Mapping[str, Judged]) -> str:
    """Return the score of the withheld kinds as tables, with 95 % confidence intervals (Wilson) in brackets."""
    kept = counted(logs.values())
    lines = [f"withheld kinds: {len(kept)} of {len(logs)} logs have a gap of {COUNTED} noise sigmas or more", ""]
    lines += [f"{name:46s}{count(kept)}" for name, count in ROWS.items()]
    lines += [f"{'the shrink holds within 0.1 on the second log':46s}{_holds(kept)}"]
    lines += [f"{f'median, {name}':46s}{_number(value):>8s}" for name, value in _words(shrinks(kept)).items()]
    verdicts = Counter(one.verdict for one in kept)
    lines += ["verdicts: " + ", ".join(f"{verdict} {n}" for verdict, n in verdicts.most_common())]
    head = "".join(f"{name:>12s}" for name in ("logs", "drive", "equivalent", "wrong names", "explained", "shrink"))
    lines += ["", f"{'noise sigmas of gap':34s}{head}"]
    lines += [f"{_span(low, high):34s}{_line(group)}" for low, high, group in _sizes(logs.values())]
    lines += ["", f"{'kind, those counted':34s}{head}"]
    lines += [f"{name:34s}{_line(group)}" for name, group in _kinds(kept).items()]
    missed = Counter((one.truth.kind, one.drive or one.verdict) for one in kept if not one.claimed)
    lines += ["", "other drives first: what it was, what it was called, logs"] if missed else []
    lines += [f"  {kind:32s} {said:24s} {n:3d}" for (kind, said), n in missed.most_common()]
    wrong = Counter((one.truth.kind, "+".join(one.wrong)) for one in kept if one.wrong)
    lines += ["", "wrong catalogue names: what it was, what it was called, logs"] if wrong else []
    lines += [f"  {kind:32s} {said:44s} {n:3d}" for (kind, said), n in wrong.most_common()]
    return "\n".join(lines)


def _words(medians: Mapping[str, float | None]) -> dict[str, float | None]:
    return {name.replace("_", " "): value for name, value in medians.items()}


def _holds(logs: Iterable[Judged]) -> Share:
    return share(
        one.second >= one.shrink - SAME_SHRINK for one in logs if one.of_mean and one.second is not None and one.shrink
    )


def _block(logs: Sequence[Judged]) -> dict[str, Any]:
    return {
        "logs": len(logs),
        "score": {name: count(logs).plain() for name, count in ROWS.items()},
        "shrink_holds_on_second_log": _holds(logs).plain(),
        "medians": shrinks(logs),
        "verdicts": dict(Counter(one.verdict for one in logs)),
    }


def _sizes(logs: Iterable[Judged]) -> list[tuple[float, float, list[Judged]]]:
    listed = list(logs)
    return [(low, high, [one for one in listed if low <= one.gap_sigmas < high]) for low, high in SIZES]


def _kinds(logs: Iterable[Judged]) -> dict[str, list[Judged]]:
    """Logs grouped by kind and form, in the order of drive, kind and form."""
    found: dict[str, list[Judged]] = defaultdict(list)
    for one in sorted(logs, key=lambda one: (one.truth.drive, one.truth.kind, one.truth.form)):
        found[f"{one.truth.kind}, {one.truth.form}"].append(one)
    return found


def _line(logs: Sequence[Judged]) -> str:
    counts = (
        sum(one.right for one in logs),
        sum(one.claimed for one in logs),
        sum(bool(one.wrong) for one in logs),
        sum(one.verdict == "explained" for one in logs),
    )
    return f"{len(logs):12d}" + "".join(f"{n:12d}" for n in counts) + f"{_number(shrinks(logs)['shrink']):>12s}"


def _row(one: Judged) -> dict[str, Any]:
    return {
        **one.truth._asdict(),
        "gap_sigmas": one.gap_sigmas,
        "verdict": one.verdict,
        "said_drive": one.drive,
        "said_equivalent": list(one.also),
        "wrong_names": list(one.wrong),
        "nearly_the_same": list(one.nearly),
        "shrink": one.shrink,
        "second_shrink": one.second,
        "errors_in_stderr": {x.unit: (x.error / x.stderr).tolist() for x in one.coefficients},
    }


def _span(low: float, high: float) -> str:
    return f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more"


def _median(values: Iterable[float | None]) -> float | None:
    listed = [value for value in values if value is not None]
    return float(np.median(listed)) if listed else None


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
