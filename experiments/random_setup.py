"""A robot with a random tool, for experiments that simulate many robots whose setup is right."""

import ftbias_jax as ft


def random_setup(rng, robot="panda"):
    inertia = rng.uniform(1e-3, 3e-3)
    return ft.parse_setup(
        {
            "robot": {"model": robot},
            "sensor": {"translation": [0.0, 0.0, 0.04], "noise_std": [0.1, 0.004]},
            "tool": {
                "mass": rng.uniform(0.5, 1.5),
                "center_of_mass": [*rng.uniform(-0.02, 0.02, 2), rng.uniform(0.03, 0.08)],
                "inertia": [inertia, 0, 0, inertia, 0, inertia / 2],
            },
            "bias": {"noise_density": [2e-3, 1e-4]},
        }
    )
