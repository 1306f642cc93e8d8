"""Joint motions with exact derivatives: sines, minimum-jerk moves, trapezoidal moves, slow scans."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import BPoly, PPoly

from validation.generator.arms import Arm, Floats

Trajectory = Callable[[Floats], tuple[Floats, Floats, Floats]]
"""t (T,) s -> q (T, n) rad, dq (T, n) rad/s, ddq (T, n) rad/s^2; also defined before and after the log."""

KINDS = ("sines", "moves", "trapezoids", "scan")
FADE = 2.5  # s, from rest to full amplitude


def random_motion(kind: str, arm: Arm, duration: float, pace: float, rng: np.random.Generator) -> Trajectory:
    """Draw a random motion of one of ``KINDS`` around the arm's home.

    Args:
        kind: one of ``KINDS``.
        arm: arm with its home and span.
        duration: s, of the log.
        pace: factor of speeds and frequencies; 1 = ordinary.
        rng: source of randomness.
    """
    return {"sines": _sines, "moves": _moves, "trapezoids": _trapezoids, "scan": _scan}[kind](arm, duration, pace, rng)


def _sines(arm: Arm, duration: float, pace: float, rng: np.random.Generator) -> Trajectory:
    """Three sines per joint, starting from rest or in motion; peak speed of each sine at most 0.5 rad/s x pace."""
    shape = (3, len(arm.home))
    frequency = rng.uniform(0.04, 0.4, shape) * pace
    omega = 2 * np.pi * frequency
    amplitude = arm.span * rng.dirichlet([2.0, 2.0, 2.0], shape[1]).T * rng.uniform(0.6, 1.0)
    amplitude = np.minimum(amplitude, 0.5 * pace / omega)
    phase = rng.uniform(0, 2 * np.pi, shape)
    from_rest = rng.uniform() < 0.6

    def motion(t: Floats) -> tuple[Floats, Floats, Floats]:
        angle = omega * t[:, None, None] + phase
        s, ds, dds = (
            (amplitude * np.sin(angle)).sum(1),
            (amplitude * omega * np.cos(angle)).sum(1),
            (-amplitude * omega**2 * np.sin(angle)).sum(1),
        )
        if not from_rest:
            return arm.home + s, ds, dds
        e, de, dde = (value[:, None] for value in _fade_in(t))
        return arm.home + e * s, de * s + e * ds, dde * s + 2 * de * ds + e * dds

    return motion


def _fade_in(t: Floats) -> tuple[Floats, Floats, Floats]:
    """Quintic step from 0 to 1 in FADE seconds, with its first two derivatives with respect to time."""
    x = np.clip(t / FADE, 0, 1)
    step = x**3 * (10 - 15 * x + 6 * x**2)
    return step, 30 * (x * (1 - x)) ** 2 / FADE, 60 * x * (1 - x) * (1 - 2 * x) / FADE**2


def _moves(arm: Arm, duration: float, pace: float, rng: np.random.Generator) -> Trajectory:
    """Minimum-jerk moves between random poses, with dwells of up to two seconds."""
    times, poses = _via_points(arm, duration, rng, speed=0.9 * pace, acceleration=4.0 * pace**2, peak=(1.875, 5.774))
    still = np.zeros_like(poses)
    path = BPoly.from_derivatives(times, np.stack([poses, still, still], 1))
    return _held(path, path.derivative(), path.derivative(2), times[-1])


def _trapezoids(arm: Arm, duration: float, pace: float, rng: np.random.Generator) -> Trajectory:
    """Moves at constant speed with steep acceleration ramps of 20 to 80 ms, as of industrial controllers."""
    times, poses = _via_points(arm, duration, rng, speed=0.8 * pace, acceleration=4.0 * pace**2, peak=(1.35, 5.5))
    return _constant_speed(times, poses, share=0.26, jerk_time=rng.uniform(0.02, 0.08))


def _scan(arm: Arm, duration: float, pace: float, rng: np.random.Generator) -> Trajectory:
    """Slow sweeps of a few joints at constant speed, 0.08 to 0.25 rad/s at most, with hardly any dwell."""
    moving = rng.permutation(len(arm.home))[: rng.integers(2, 4)]
    mask = np.full(len(arm.home), 0.15)
    mask[moving] = 1.0
    mask[-3:] = np.maximum(mask[-3:], 0.5)  # a log without wrist rotation is uninformative
    speed = rng.uniform(0.15, 0.35) * pace
    times, poses = _via_points(arm, duration, rng, speed, acceleration=4.0, peak=(1.1, 5.5), mask=mask, dwell=0.3)
    return _constant_speed(times, poses, share=0.08, jerk_time=0.04)


def _via_points(
    arm: Arm,
    duration: float,
    rng: np.random.Generator,
    speed: float,
    acceleration: float,
    peak: tuple[float, float],
    mask: Floats | float = 1.0,
    dwell: float = 2.0,
) -> tuple[Floats, Floats]:
    """Draw times (K,) s and poses (K, n) rad of alternating dwells and moves; the first dwell starts at 0.

    Args:
        arm: arm with its home and span.
        duration: s, of the log.
        rng: source of randomness.
        speed: rad/s, limit of the fastest joint.
        acceleration: rad/s^2, limit of the fastest joint.
        peak: peak speed and acceleration of the profile for unit distance in unit time.
        mask: share of the span that each joint uses.
        dwell: s, longest dwell.
    """
    times, poses = [0.0], [arm.home + mask * arm.span * rng.uniform(-0.5, 0.5, len(arm.home))]
    while times[-1] < duration:
        times.append(times[-1] + rng.uniform(0.1, 1.0) * dwell)
        poses.append(poses[-1])
        target = arm.home + mask * arm.span * rng.uniform(-1, 1, len(arm.home))
        distance = np.abs(target - poses[-1]).max()
        seconds = max(peak[0] * distance / speed, np.sqrt(peak[1] * distance / acceleration), 0.4)
        times.append(times[-1] + seconds * rng.uniform(1.0, 1.4))
        poses.append(target)
    return np.array(times), np.array(poses)


def _constant_speed(times: Floats, poses: Floats, share: float, jerk_time: float) -> Trajectory:
    """Accelerate during ``share`` of each move, cruise, decelerate; the acceleration ramps take ``jerk_time`` s."""
    knots, values = [times[0]], [np.zeros(poses.shape[1])]
    for start, end, step in zip(times[:-1], times[1:], np.diff(poses, axis=0), strict=True):
        if not step.any():
            continue
        total, ramp = end - start, max(share * (end - start), 2.5 * jerk_time)
        top = step / ((ramp - jerk_time) * (total - ramp))
        corners = np.array([0, jerk_time, ramp - jerk_time, ramp])
        knots += [*(start + corners), *(end - corners[::-1])]
        values += [0 * top, top, top, 0 * top, 0 * top, -top, -top, 0 * top]
    x, a = np.array(knots), np.array(values)
    x, kept = np.unique(x, return_index=True)
    a = a[kept]
    acceleration = PPoly(np.stack([np.diff(a, axis=0) / np.diff(x)[:, None], a[:-1]]), x)
    velocity = acceleration.antiderivative()
    position = velocity.antiderivative()
    held = _held(position, velocity, acceleration, x[-1])
    return lambda t: (poses[0] + held(t)[0], *held(t)[1:])


def _held(position: PPoly, velocity: PPoly, acceleration: PPoly, end: float) -> Trajectory:
    """Motion that is at rest before 0 and after ``end`` s."""

    def motion(t: Floats) -> tuple[Floats, Floats, Floats]:
        inside = np.clip(t, 0, end)
        moving = ((t > 0) & (t < end))[:, None]
        return position(inside), velocity(inside) * moving, acceleration(inside) * moving

    return motion
