"""Identify the mass, centre of mass and inertia of a tool whose values in the setup are inaccurate."""

from dataclasses import replace
from pathlib import Path

import ftbias_jax as ft

truth = ft.load_setup(Path(__file__).with_name("setup.toml"))
log = ft.simulate(truth, duration=15, rate=200, seed=3).log

nominal = replace(truth, tool=replace(truth.tool, mass=0.7, center_of_mass=[0.0, 0.0, 0.05]))
found = ft.identify_tool(nominal, log)
print(found)
print(f"mass: nominal {nominal.tool.mass} kg, found {found.setup.tool.mass:.4f} kg, truth {truth.tool.mass} kg")
found.setup.save("identified.toml")
