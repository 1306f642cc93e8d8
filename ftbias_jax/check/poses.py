"""Conventions of a recorded pose that are easily mistaken: the quaternion, the axes of the position, an IMU's units."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from ftbias_jax.check.motion import in_sensor
from ftbias_jax.check.result import Mistake
from ftbias_jax.check.state import State, motion_of_pose
from ftbias_jax.setup.recorded import PoseSetup

Values = dict[str, str | bool]
"""Full keys of a setup and what to write there."""
OTHER = {"quaternion_xyzw": "quaternion_wxyz", "quaternion_wxyz": "quaternion_xyzw"}
OTHER_AXES = {"base": "body", "body": "base"}
DEGREES: Values = {"log.angle_unit": "deg"}
GYROSCOPES: dict[float, tuple[str, Values]] = {
    180 / np.pi: ('in deg/s: set log.angle_unit = "deg"', DEGREES),
    np.pi / 180: ("57.3 times too small: it was converted from degrees twice", {}),
    30 / np.pi: ("in revolutions per minute: convert it to rad/s", {}),
    1e3: ("in mrad/s: convert it to rad/s", {}),
}
"""Ratio of recorded to true rates -> description of the units, and the setup keys that state them."""
POSE_BETTER = 0.7
"""Maximum residual of another convention of a pose, relative to that of the stated one."""
NEAR = 1.25
"""Factor within which a ratio agrees with one of GYROSCOPES."""
TURNING = 0.02
"""rad/s, rms; slower motion does not constrain the units of a gyroscope."""
ALIKE = 0.8
"""Correlation of gyroscope and orientation above which their magnitudes can be compared."""
MOST_G, LEAST_G = 1.3, 0.7
"""Bounds of the median norm of a specific force that is in g."""


@dataclass(frozen=True)
class Convention:
    """How a recorded pose is read, where it differs from the setup."""

    reordered: bool = False
    """The quaternion has the other order of its entries."""
    inverse: bool = False
    """The quaternion maps vectors from the base frame to the body frame."""
    in_body: bool = False
    """The position is expressed in the body's axes."""

    def findings(self, pose: PoseSetup) -> Iterator[tuple[str, str, Values]]:
        """Yield mistake, remedy and setup keys of each difference."""
        words: list[str] = []
        setup: Values = {}
        if self.reordered:
            other = OTHER[pose.orientation]
            setup["sensor_pose.orientation"] = other
            words.append(f'the quaternion is in the other order: set sensor_pose.orientation = "{other}"')
        if self.inverse:
            setup["sensor_pose.conjugate"] = not pose.conjugate
            turns = "the orientation turns vectors of the base into the body's axes"
            turns = "the orientation turns vectors of the body into the base's axes" if pose.conjugate else turns
            words.append(f"{turns}: set sensor_pose.conjugate = {'false' if pose.conjugate else 'true'}")
        if words:
            yield "quaternion_convention", "; ".join(words), setup
        if self.in_body:
            axes = OTHER_AXES[pose.position_axes]
            remedy = f'the position has the axes of the {axes}: set sensor_pose.position_axes = "{axes}"'
            yield "position_frame", remedy, {"sensor_pose.position_axes": axes}


def conventions(state: State) -> Iterator[tuple[Convention, State]]:
    """Yield every convention for reading the pose, the stated one first, with the state that it gives."""
    case = state.case
    pose = case.setup.pose
    assert pose is not None
    reorder = (False, True) if pose.orientation in OTHER else (False,)
    position = (False, True) if pose.linear == "position" else (False,)
    to_other = [1, 2, 3, 0] if pose.orientation == "quaternion_xyzw" else [3, 0, 1, 2]
    for inverse, reordered, in_body in product((False, True), reorder, position):
        entries = [*(to_other if reordered else range(4)), *range(4, case.bins.q.shape[1])]
        signs = np.ones(len(entries))
        signs[1:4] = -1 if inverse else 1
        arrays = (x[:, entries] * signs for x in (case.bins.q, case.bins.dq, case.bins.ddq))
        motion = motion_of_pose(case.setup, *arrays, in_body=in_body)
        yield Convention(reordered, inverse, in_body), state.but(motion=motion)


def gyroscope_mistake(state: State) -> Mistake | None:
    """Return the mistake in the gyroscope's units; None if there is none."""
    measured = state.case.bins.gyroscope
    if measured is None:
        return None
    known = in_sensor(state.motion, state.motion.velocity)
    rows = np.isfinite(measured).all(1)
    measured, known = measured[rows], known[rows]
    if not rows.any() or np.sqrt((known**2).sum(1).mean()) < TURNING:
        return None
    overlap = (measured * known).sum()
    alike = overlap / np.sqrt((measured**2).sum() * (known**2).sum() + 1e-300)
    ratio = overlap / (known**2).sum()
    for factor, (words, setup) in GYROSCOPES.items():
        if alike > ALIKE and factor / NEAR < ratio < factor * NEAR:
            evidence = {"ratio_to_the_orientation": float(f"{ratio:.4g}")}
            return Mistake("gyroscope_units", evidence, f"the gyroscope is {words}", setup)
    return None


def accelerometer_mistake(state: State) -> Mistake | None:
    """Return the mistake in the accelerometer's units; None if there is none."""
    if state.specific_force is None:
        return None
    size = float(np.median(np.linalg.norm(state.specific_force, axis=1)))
    if LEAST_G < size < MOST_G:
        words = 'the specific force is in g: set log.acceleration_unit = "g"'
        evidence = {"median_specific_force": float(f"{size:.4g}")}
        return Mistake("gyroscope_units", evidence, words, {"log.acceleration_unit": "g"})
    return None
