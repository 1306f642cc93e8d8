"""What a drafted setup says of the tool, by its weight in the log."""

from __future__ import annotations

import numpy as np

from ftbias_jax.io.draft.gravity import Weighed
from ftbias_jax.io.draft.robot import Keys
from ftbias_jax.setup.keys.template import MEASURE, Known

NOT_TURNED = (
    "the sensor is not turned in this log, so its weight shows nothing of the tool: ftbias filter takes an unknown "
    "weight as part of the bias of such a log"
)


def tool_keys(found: Weighed | None, is_stated: bool) -> tuple[Keys, list[str]]:
    """Keys, and a line for the person who asked.

    Args:
        found: the tool as weighed; None = the log does not turn the sensor.
        is_stated: whether somebody has stated the tool's mass: then a missing weight is a matter for ``check``.
    """
    if found is None:
        return {}, [NOT_TURNED]
    if found.absent and not is_stated:
        why = (
            f"the sensor turns by {np.degrees(found.turn):.0f} degrees, and the forces show at most "
            f"{found.heaviest:.2g} kg: the controller subtracts the payload, or there is no tool"
        )
        return {"sensor.compensated": Known("tool", why)}, [why]
    words = (
        f"{abs(found.mass):.3g} \u00b1 {found.mass_stderr:.2g} kg, which leaves {found.residual:.2g} N of the forces"
    )
    if not found.credible:
        return {}, [f"the weight that the log shows is not credible: {words}"]
    return _weighed(found), [f"weighed by the log: {words}"]


def _weighed(found: Weighed) -> Keys:
    remark = f"by its weight in the log; {MEASURE}"
    keys = {
        "tool.mass": Known(float(f"{abs(found.mass):.4g}"), f"\u00b1 {found.mass_stderr:.2g} {remark}"),
        "tool.center_of_mass": Known([round(float(x), 4) for x in found.center_of_mass], remark),
        "tool.mass_std": Known(float(f"{found.mass_stderr:.2g}"), "for the error bars"),
        "tool.center_of_mass_std": Known([float(f"{x:.2g}") for x in found.center_stderr], "for the error bars"),
    }
    if found.mass < 0:
        keys["sensor.reports"] = Known("wrench_on_sensor", "because the weight has the opposite sign")
    return keys
