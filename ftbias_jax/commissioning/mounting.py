"""Rotation of the sensor on the flange, which a drafted setup does not state: found first if the logs show one."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ftbias_jax.calibration.identify_tool import identify_tool
from ftbias_jax.check.check_setup import check_setup
from ftbias_jax.commissioning.drafted import loosened
from ftbias_jax.commissioning.logs import longest
from ftbias_jax.commissioning.result import MOUNTING, Step
from ftbias_jax.errors import FtbiasError, SetupError
from ftbias_jax.io.log import Log
from ftbias_jax.setup.require import is_draft
from ftbias_jax.setup.rotations import vector_from_rotation
from ftbias_jax.setup.types import Setup

TURNED = "sensor_axes"


def with_mounting(
    setup: Setup, whole: Sequence[Log], begun: Sequence[Log], progress: Callable[[str], None]
) -> tuple[Setup, tuple[Step, ...]]:
    """Check a setup, and find the rotation of its sensor if that is all that is wrong in a draft.

    Args:
        setup: setup as it is given.
        whole: whole logs, cleaned.
        begun: the logs without their held-out ends, from which the rotation is found.
        progress: called with the name of the stage.

    Returns:
        the setup with the rotation and the tool that the logs show with it, and the step; () = the setup is right.

    Raises:
        SetupError, LogError: as ``Check.require_ok``.
    """
    check = check_setup(setup, whole)
    try:
        check.require_ok("calibrate")
        return setup, ()
    except SetupError as error:
        open_rotation = np.array_equal(setup.sensor.rotation, np.eye(3)) and (is_draft(setup) or setup.tool.unknown)
        if error.field != TURNED or not open_rotation:
            raise
        wrong = error
    progress("identifying how the sensor is turned on the flange")
    check.require_ok("calibrate", looked_for=(TURNED,))
    try:
        found = identify_tool(setup, longest(begun), mounting=True, translation=False).setup
        turned = replace(loosened(found, setup), bias=replace(setup.bias, model_std=found.bias.model_std))
        check_setup(turned, whole).require_ok("calibrate")
    except FtbiasError:
        raise wrong from None
    vector = ", ".join(f"{x:.3g}" for x in np.degrees(vector_from_rotation(turned.sensor.rotation)))
    why = "the logs show it, and contradict the flange's axes"
    return turned, (Step(MOUNTING, f"sensor turned on the flange by [{vector}] degrees", True, why, ("mounting",)),)
