"""Define an effect with an unknown position: a magnet beside the path attracts the tool."""

# --8<-- [start:effect]
import itertools

import jax.numpy as jnp

import ftbias_jax as ft

# Start positions of the search, around the robot: m, base frame.
PLACES = tuple(itertools.product((-0.6, 0.0, 0.6), (-0.6, 0.0, 0.6), (0.0, 0.5)))


def pull(values, signals, wrench):
    away = values["place"] - signals.path.position  # (T, 3) m, from the sensor to the magnet
    distance = jnp.linalg.norm(away, axis=1, keepdims=True)
    return wrench + signals.push(values["strength"] * away / distance**3)


MAGNET = ft.Effect(
    "magnet",
    "environment",
    (
        ft.Parameter("strength", "N m^2", "force times squared distance", scale=0.5),
        ft.Parameter("place", "m", "base frame", (3,), -2, 2, scale=0.2, search=True, starts=PLACES),
    ),
    "a magnet attracts the tool",
    "keep the tool away from it, or shield it",
    reading=pull,
    twins=(ft.Twin("cable", False, "move the tool nearer: a cable pulls less there, a magnet more"),),
)
# --8<-- [end:effect]

if __name__ == "__main__":
    from pathlib import Path

    setup = ft.load_setup(Path(__file__).with_name("setup.toml"))
    values = {"magnet": {"strength": 0.5, "place": [0.6, 0.3, 0.5]}}
    simulated = ft.simulate(setup, values, own=[MAGNET], duration=20, rate=100, seed=5)
    diagnosis = ft.diagnose(setup, [simulated.log], effects=[MAGNET])
    print(diagnosis)
    (cause,) = diagnosis.causes
    assert cause.effect == "magnet"
    assert abs(cause.parameters["strength"] - 0.5) < 4 * cause.stderr["strength"]
