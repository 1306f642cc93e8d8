"""Which effects a log of the sensor's pose cannot show, because they are of the joints of an arm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ftbias_jax.errors import SetupError
from ftbias_jax.model.effects.catalogue import MakeError
from ftbias_jax.model.effects.terms.parse import NAME as TERM
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.setup.types import Setup

OF_JOINTS = "it is of the joints of an arm, and the sensor's pose is recorded instead"
OF_ACCELERATION = "the sensor's acceleration is not recorded"


def not_shown(setup: Setup) -> dict[str, str]:
    """Effects that no log of this setup can show, and why."""
    if setup.pose is None:
        return {}
    why = {"joints": OF_JOINTS} | ({"acceleration": OF_ACCELERATION} if setup.pose.linear == "none" else {})
    needed = {name: effect.needs_motion for name, effect in catalogue_of_setup(setup).items()}
    return {name: why[motion] for name, motion in needed.items() if motion in why}


def check_shown(effects: Mapping[str, Any], setup: Setup, error: MakeError = SetupError, prefix: str = "") -> None:
    """Refuse effects, name -> values as written, that no log of this setup can show."""
    reasons = not_shown(setup)
    of_terms = [section for section in effects.get(TERM, ()) if isinstance(section, Mapping)]
    if setup.pose is not None and any("joint" in f"{s.get('drive')} {s.get('frame')}" for s in of_terms):
        reasons[TERM] = OF_JOINTS
    for name in effects:
        if name in reasons:
            message = f"does not go with [sensor_pose]: {reasons[name]}"
            raise error(message, field=f"{prefix}{name}", remedy="remove it, or record the joints")
