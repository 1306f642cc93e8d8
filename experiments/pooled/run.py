#!/usr/bin/env python3
"""Sixty days of sixty robots, half with a cause: is it named, dated, and found earlier from pooled than single logs?

python run.py [--robots 30] [--seed 0] [--compared 5]. Logs are simulated by MuJoCo (``experiments/validation``). Each
robot's logs are diagnosed together (``ft.diagnose_pooled``). Those of some robots are also diagnosed day by day, both
with all earlier ones and one by one, where an alarm is defined as in ``ftbias report``.
"""

import argparse
import sys
import time
from pathlib import Path

import jax
import numpy as np
from robots import DAYS, FIRST, history

import ftbias_jax as ft
from ftbias_jax.fleet.alarms import appears

sys.path.append(str(Path(__file__).parents[1]))

HEALTHY = 1000
"""Added to the seeds of healthy robots."""
LATER = (1, 2, 3, 5, 8, 12, 17, 23, 30, 38, 48)
"""Days after the first one with the cause on which all logs so far are diagnosed together."""


def together(made, last=DAYS):
    """Pooled diagnosis of the first ``last`` days: verdict, causes with their twins, time courses."""
    found = ft.diagnose_pooled(made.setup, made.logs[:last])
    causes = [(cause.effect, *cause.indistinguishable_from) for cause in found.causes]
    return found.verdict, causes, found.courses


def day_of(date):
    """Index of the day of a date in s since 1970."""
    return round((date - FIRST) / 86400)


def one(seed, healthy):
    """Simulate a robot; return its history, and the pooled diagnosis of its logs as a row."""
    made, began = history(seed, healthy), time.process_time()
    verdict, causes, courses = together(made)
    row = {
        "seed": seed,
        "cause": made.cause,
        "day": made.day if made.cause else None,
        "grows": made.grows,
        "gap_sigmas": round(made.gap, 2),
        "verdict": verdict,
        "causes": causes,
        "cpu_seconds": round(time.process_time() - began, 1),
    }
    for course in courses:
        edges = [day_of(date) for date in (course.since, course.earliest, course.latest)]
        row[course.effect] = {"begins": course.begins, "day": edges[0], "between": edges[1:]}
        row[course.effect] |= {"before": round(course.before, 3), "scatter": course.scatter}
    return made, row


def compared(made):
    """Days from the first one with the cause until an alarm, by pooled diagnosis and by diagnosis log by log."""
    found = {"together": None, "one by one": None}
    for later in (days for days in LATER if made.day + days < DAYS):
        _, causes, courses = together(made, made.day + later + 1)
        began = {course.effect for course in courses if course.begins != "all along"}
        if any(made.cause in names and began & set(names) for names in causes):
            found["together"] = later
            break
    flags = [False] * made.day
    for day in range(made.day, DAYS):
        single = ft.diagnose(made.setup, [made.logs[day]])
        flags.append(
            made.cause in {name for cause in single.causes for name in (cause.effect, *cause.indistinguishable_from)}
        )
        if appears(flags) is not None:
            found["one by one"] = day - made.day
            break
    return found


def is_named(row):
    """Whether the cause is the first one named, or a declared twin of it."""
    return bool(row["causes"]) and row["cause"] in row["causes"][0]


def course_in(row):
    """Time course of the cause that was named first."""
    return row.get(row["causes"][0][0]) if row["causes"] else None


def table(rows):
    """Numbers of causes named, errors of their first days, and false alarms."""
    sick, well = ([row for row in rows if bool(row["cause"]) == there] for there in (True, False))
    named = [row for row in sick if is_named(row) and course_in(row)]
    off = np.array([course_in(row)["day"] - row["day"] for row in named])
    inside = [course_in(row)["between"][0] < row["day"] <= course_in(row)["between"][1] for row in named]
    days = [row["compared"] for row in sick if "compared" in row]
    return {
        "robots with a cause": len(sick),
        "named first": sum(map(is_named, sick)),
        "begins, and not all along": sum(course_in(row)["begins"] != "all along" for row in named),
        "day right within one": int((np.abs(off) <= 1).sum()),
        "day right within three": int((np.abs(off) <= 3).sum()),
        "day inside its 95 %": int(np.sum(inside)),
        "healthy robots": len(well),
        "healthy with a cause": sum(bool(row["causes"]) for row in well),
        "compared": len(days),
        "median days until found, together": float(np.median([_or_never(one["together"]) for one in days] or [0])),
        "median days until found, one by one": float(np.median([_or_never(one["one by one"]) for one in days] or [0])),
        "never found one by one": sum(one["one by one"] is None for one in days),
    }


def _or_never(days):
    return DAYS if days is None else days


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=30, help="with a cause, and as many healthy ones")
    parser.add_argument("--seed", type=int, default=0, help="of the first robot")
    parser.add_argument("--compared", type=int, default=5, help="robots that are followed day by day")
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    rows = []
    for number in range(2 * asked.robots):
        healthy, which = number % 2 == 1, number // 2
        made, row = one(asked.seed + which + HEALTHY * healthy, healthy)
        if not healthy and which < asked.compared:
            row["compared"] = compared(made)
        rows.append(row)
        print(row, flush=True)
    from common import keep

    print(table(rows))
    keep(__file__, {"table": table(rows), "robots": rows})
