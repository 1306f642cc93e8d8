"""Static HTML page of a plan: expected standard errors, the path, and how much of the limits it uses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftbias_jax.check.motion import arm_motion
from ftbias_jax.diagnosis.report import svg
from ftbias_jax.diagnosis.report.page import bullets, figure, html_table, section, typeset, whole_page
from ftbias_jax.diagnosis.report.plots import MAX_BUCKETS
from ftbias_jax.planning.limits import NOT_KNOWN, QUANTITIES, limits_of

if TYPE_CHECKING:
    from ftbias_jax.planning.result import Plan

VIEWS = (("from above", 0, 1), ("from the side", 0, 2))
"""Views of the tip's path: name, and the axes of the base frame drawn horizontally and vertically."""
PATH_POINTS = 1500
ROW, NAMES = 24, 100
"""Drawing units: height of a bar, and width of its name."""


def plan_page(plan: Plan) -> str:
    """HTML of a plan, as one self-contained file."""
    forecast, columns = plan.forecast, plan.forecast.columns
    names = [f"{name} [{unit}]" for name, unit in zip(forecast.labels, forecast.units, strict=True)]
    rows = list(zip(names, *columns.values(), strict=True))
    separates = [
        f"{svg.escape(name)}: {nats:.1f} nats; five standard deviations are 12.5"
        for name, nats in forecast.separates.items()
    ]
    cannot = [f"{svg.escape(one.pair)}: {svg.escape(one.why)}" for one in forecast.cannot]
    paths = "".join(figure(_path(plan, *view), f"The path of the tip, {view[0]}, base frame.") for view in VIEWS)
    joints = "".join(figure(_joint(plan, j), "") for j in range(plan.motion.q.shape[1]))
    used = figure(_used(plan), "Largest share over all joints, at 1 kHz.")
    asked, seconds = plan.options.to_find, plan.options.duration
    body = (
        f"<header><p class='small'>Planned motion</p><h1>{svg.escape(f'{seconds:g} s for {asked}')}</h1></header>"
        + section("Standard errors to expect", html_table(("parameter", *columns), rows) + bullets(separates))
        + section("What it does not tell", bullets(cannot))
        + section("What is not known", f"<p>{typeset(NOT_KNOWN)}</p>" + bullets(map(svg.escape, plan.assumed)))
        + section("Where it goes", f"<div class='grid'>{paths}</div>")
        + section("How much of the limits it uses", f"<div class='grid'>{used}<div></div></div>")
        + section(
            "The joints", f"<p class='small'>Band: the travel that is allowed.</p><div class='grid'>{joints}</div>"
        )
    )
    return whole_page("Planned motion", body)


def tip_path(plan: Plan) -> np.ndarray:
    """(T, 3) m, base frame: path of the tool's tip, or of its centre of mass if the setup states no tip."""
    step = max(1, len(plan.motion.t) // PATH_POINTS)
    limits, _ = limits_of(plan.setup, plan.motion.q[0], 0.0)
    moving = arm_motion(plan.setup.robot, plan.setup.sensor, *(x[::step] for x in plan.motion[1:4]))
    return moving.position + moving.rotation @ limits.points[-1]


def _path(plan: Plan, name: str, across: int, up: int) -> str:
    """The path of the tip in one plane of the base frame, with the box and the floor where they are stated."""
    path, stated = tip_path(plan), plan.setup.limits
    low, high = (
        np.zeros(0) if x is None else np.asarray(x)[[across, up]] for x in (stated.box_lower, stated.box_upper)
    )
    values = [
        np.concatenate([path[:, axis], *(corner[k : k + 1] for corner in (low, high))])
        for k, axis in enumerate((across, up))
    ]
    ranges = [svg.data_range(x) for x in values]
    half = max(b - a for a, b in ranges) / 2  # the same scale both ways
    x, y = (((a + b) / 2 - half, (a + b) / 2 + half) for a, b in ranges)
    axes = svg.Axes(x, y, top=24, height=svg.WIDTH - 56)
    parts = [svg.frame(axes, f"{'xyz'[up]} [m]", svg.x_axis(axes, f"{'xyz'[across]} [m]"))]
    right, bottom = axes.left + axes.width, axes.top + axes.height
    heights = [stated.floor] if up == 2 and stated.floor is not None else []
    for corner in (low, high):
        heights += corner[1:].tolist()
        parts += [svg.line(x, axes.top, x, bottom, "reference") for x in axes.across(corner[:1]).tolist()]
    parts += [svg.line(axes.left, y, right, y, "reference") for y in axes.down(np.array(heights)).tolist()]
    parts.append(svg.curve(axes, path[:, across], path[:, up], "line-after"))
    words = f"{name}, from {path.min(0).round(2).tolist()} to {path.max(0).round(2).tolist()} m"
    return svg.drawing(f"path-{across}{up}", axes.top + axes.height + 36, f"Path of the tip, {name}", words, parts)


def _used(plan: Plan) -> str:
    """Bars of the largest share of each limit."""
    shares = dict(zip(QUANTITIES, plan.used.max(1).tolist(), strict=True))
    axes = svg.Axes((0.0, 1.05), (0.0, 1.0), NAMES, 6, svg.WIDTH - NAMES - 50, ROW * len(shares))
    parts = [svg.x_axis(axes, "share of the limit")]
    for row, (name, share) in enumerate(shares.items()):
        y, end = axes.top + row * ROW, float(axes.across(np.array(share)))
        parts += [
            svg.label(NAMES - 8, y + 16, name, "end", "name"),
            svg.box(axes.left, y + 3, end - axes.left, ROW - 6, "fill-after"),
        ]
        parts.append(svg.label(axes.left + axes.width + 6, y + 16, f"{share:.0%}"))
    one = float(axes.across(np.array(1.0)))
    parts.append(svg.line(one, axes.top, one, axes.top + axes.height, "reference"))
    words = "; ".join(f"{name} {share:.0%}" for name, share in shares.items())
    return svg.drawing("used", axes.top + axes.height + 36, "Shares of the limits", words, parts)


def _joint(plan: Plan, joint: int) -> str:
    """A joint's angle against time within the travel that is allowed."""
    name, motion = plan.setup.robot.joint_names[joint], plan.motion
    limits, _ = limits_of(plan.setup, motion.q[0], plan.options.margin)
    low, high = limits.lower[joint], limits.upper[joint]
    t, q = motion.t, motion.q[:, joint]
    axes = svg.Axes((0.0, float(t[-1])), svg.data_range(q, np.array([low, high])), top=24)
    both = np.array([0.0, t[-1]])
    parts = [
        svg.frame(axes, f"{name} [rad]", svg.x_axis(axes, "time [s]")),
        svg.band(axes, both, np.full(2, low), np.full(2, high), "noise"),
        svg.curve(axes, *svg.thin(t, q, MAX_BUCKETS), "line-after"),
    ]
    words = f"from {q.min():.2f} to {q.max():.2f} rad, allowed from {low:.2f} to {high:.2f}"
    return svg.drawing(f"joint-{joint}", axes.top + axes.height + 34, f"Joint {name}", words, parts)
