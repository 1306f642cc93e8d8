"""Five effects that are not in the catalogue, written as the how-to page describes."""

import itertools

import jax.numpy as jnp

import ftbias_jax as ft

PLACES = tuple(itertools.product((-0.5, 0.5, 1.0), (-0.6, 0.0, 0.6), (0.0, 0.6, 1.2)))
SIX = (1.0, 1.0, 1.0, 0.05, 0.05, 0.05)


def drag(values, signals, wrench):
    return wrench + signals.push(-values["coefficient"] * signals.path.velocity, values["point"])


def pull(values, signals, wrench):
    away = values["place"] - signals.path.position
    squared = (away**2).sum(1, keepdims=True) + 1e-4  # keeps the force finite, because a magnet is not a point
    return wrench + signals.push(values["strength"] * away / squared**1.5)


def gyroscope(values, signals, wrench):
    torque = jnp.cross(signals.in_sensor(signals.path.angular_velocity), values["momentum"])
    return wrench + jnp.pad(torque, ((0, 0), (3, 0)))


def ripple(values, signals, wrench):
    angle = values["teeth"] * signals.q[:, 2, None]
    return wrench + values["cosine"] * (jnp.cos(angle) - 1) + values["sine"] * jnp.sin(angle)


def twist(values, signals, wrench):
    return wrench.at[:, 5].add(values["stiffness"] * signals.q[:, -1])


EFFECTS = (
    ft.Effect(
        "hose_drag",
        "environment",
        (
            ft.Parameter("coefficient", "N s/m", "force per velocity", lower=0, scale=5.0),
            ft.Parameter("point", "m", "where it acts, sensor frame", (3,), -1, 1, scale=0.05, search=True),
        ),
        "a hose drags at the tool, the faster the more",
        "route the hose so that it moves freely",
        reading=drag,
    ),
    ft.Effect(
        "magnet",
        "environment",
        (
            ft.Parameter("strength", "N m^2", "force times squared distance", scale=0.5),
            ft.Parameter("place", "m", "base frame", (3,), -3, 3, scale=0.2, search=True, starts=PLACES),
        ),
        "a magnet attracts the tool",
        "keep the tool away from it, or shield it",
        reading=pull,
        twins=(ft.Twin("cable", False, "move the tool nearer: a cable pulls less there, a magnet more"),),
    ),
    ft.Effect(
        "rotor",
        "tool",
        (ft.Parameter("momentum", "Nm s", "angular momentum of the spindle, sensor axes", (3,), scale=0.05),),
        "a spindle in the tool resists turning",
        "switch the spindle off, or keep this correction",
        reading=gyroscope,
    ),
    ft.Effect(
        "gear_ripple",
        "environment",
        (
            ft.Parameter("cosine", "N, Nm", "amplitude in phase", (6,), scale=SIX),
            ft.Parameter("sine", "N, Nm", "amplitude out of phase", (6,), scale=SIX),
            ft.Parameter(
                "teeth", "1", "periods in a turn of joint 3", lower=1, upper=40, neutral=1, scale=0, search=True
            ),
        ),
        "a gear of joint 3 shakes the arm with its teeth",
        "have the gear looked at",
        reading=ripple,
    ),
    ft.Effect(
        "hose_twist",
        "environment",
        (ft.Parameter("stiffness", "Nm/rad", "torque about z per turn of the last joint", scale=0.1),),
        "a hose along the last axis is twisted",
        "give the hose a swivel",
        reading=twist,
    ),
)
