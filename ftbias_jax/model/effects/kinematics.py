"""Effects of the kinematics stage: gravity, mounting or joint angles differ from the setup and the encoders."""

from functools import partial

import jax.numpy as jnp

from ftbias_jax.model.effects.fitting import ByJoint, Fitting, Linear
from ftbias_jax.model.effects.statements import DEGREES, amount, angle, distance
from ftbias_jax.model.effects.types import Effect, EffectValues, Model, Parameter, Signals, Twin, motion_of, within
from ftbias_jax.model.kinematics.arm_batch import jacobians
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.kinematics.screws import Arm, rotation_from_vector
from ftbias_jax.model.wrench.inertia import turned
from ftbias_jax.types import Array


def gravity_tilt(values: EffectValues, signals: Signals) -> Signals:
    """Gravity with another direction in the base frame; its magnitude stays, whatever the length of the parameter."""
    model = signals.model
    direction = values["gravity"]
    size = jnp.sqrt((model.gravity @ model.gravity) / (direction @ direction))
    return signals._replace(model=model._replace(gravity=size * direction))


def encoder_offset(values: EffectValues, signals: Signals) -> Signals:
    """One encoder reads too high by the offset: recorded angle = true angle + offset; several if both are arrays."""
    return subtract_offsets(_of_joints(values, "offset", signals), signals)


def joint_flexibility(values: EffectValues, signals: Signals) -> Signals:
    """A joint gives way under the weight it carries: true angle = recorded angle + deflection x lever.

    The weights of links and tool are taken to act at the sensor's origin, because the links' are not known. The lever
    changes so slowly that the rates of the deflection are neglected.
    """
    carrier: Arm | FreeBody = signals.model.arm
    if isinstance(carrier, FreeBody):
        return signals  # a recorded pose has no joints
    # Torque about each joint of a weight of 1 N at the sensor's origin; along a prismatic joint, its force.
    down = signals.model.gravity / jnp.sqrt(signals.model.gravity @ signals.model.gravity)
    lever = jnp.einsum("tin,i->tn", jacobians(carrier, motion_of(signals))[:, :3], down)
    return subtract_offsets(-_of_joints(values, "deflection", signals)[None] * lever, signals)


def _of_joints(values: EffectValues, name: str, signals: Signals) -> Array:
    """Parameter of one joint -> (n,) for all joints, 0 for the others."""
    own = jnp.arange(1, signals.q.shape[1] + 1) == jnp.round(values["joint"])
    return jnp.where(own, values[name], 0)


def subtract_offsets(offsets: Array, signals: Signals) -> Signals:
    """True joint angles from the recorded ones, with an offset (n,) or (T, n) rad at every joint."""
    return signals._replace(q=signals.q - jnp.atleast_2d(offsets), motion=None)


def mount_translation(values: EffectValues, signals: Signals) -> Signals:
    """The sensor's origin, and the tool with it, is displaced from the nominal one by d, sensor axes."""
    arm, moving, d = signals.model.arm, motion_of(signals), values["translation"]
    arm = arm._replace(zero_position=arm.zero_position + arm.zero_rotation @ d)
    lever = jnp.einsum("ijt,j->it", moving.sensor_rotation, d)
    cross = partial(jnp.cross, axis=0)
    turning = cross(moving.angular_velocity, lever)
    moving = moving._replace(
        sensor_position=moving.sensor_position + lever,
        velocity=moving.velocity + turning,
        acceleration=moving.acceleration
        + cross(moving.angular_acceleration, lever)
        + cross(moving.angular_velocity, turning),
    )
    return signals._replace(model=signals.model._replace(arm=arm), motion=moving)


def mount_rotation(values: EffectValues, signals: Signals, wrench: Array) -> Array:
    """The sensor's axes are the nominal ones rotated by the rotation vector r: reading = exp([r])^T W."""
    return (wrench.reshape(-1, 2, 3) @ rotation_from_vector(values["rotation"])).reshape(-1, 6)


def tool_turns(values: EffectValues, signals: Signals) -> Signals:
    """The tool in the nominal axes: as stated if it stays, rotated by r if it is bolted to the sensor."""
    rotation, model = rotation_from_vector(values["tool_turns"] * values["rotation"]), signals.model
    return signals._replace(model=model._replace(theta=turned(model.theta, rotation)))


def _of_stated_size(values: EffectValues, model: Model) -> EffectValues:
    gravity = values["gravity"]
    return {"gravity": gravity * jnp.linalg.norm(model.gravity) / jnp.linalg.norm(gravity)}


JOINT = Parameter("joint", "1", "number of the joint, from 1", (), 1, 64, 2.0, 0.0, search=True)
LOAD_IT = "stretch and fold the arm, or carry more: an offset stays as it is"
"""What separates a joint that gives way from an encoder with an offset."""

EFFECTS = (
    Effect(
        "joint_flexibility",
        "kinematics",
        (
            JOINT,
            Parameter(
                "deflection",
                "rad/m",
                "how far the joint gives way per metre between its axis and the sensor, measured horizontally",
                **within((), 0, 1, 0, 0.005),
            ),
        ),
        "a joint, or what it is mounted on, gives way under the weight of arm and tool, which its encoder does not see",
        "calibrate the stiffness of the joints, or measure their angles behind the gears",
        transform=joint_flexibility,
        needs_motion="joints",
        fit=Fitting(ByJoint("joint", "deflection")),
        twins=(
            Twin("none", True, "a joint whose axis is vertical carries no weight"),
            Twin("encoder_offset", False, LOAD_IT),
        ),
        statement=amount("joint {joint:.0f} gives way by {value} deg per metre of reach", "deflection", DEGREES),
    ),
    Effect(
        "gravity_tilt",
        "kinematics",
        (
            Parameter(
                "gravity",
                "m/s^2",
                "gravity in the base frame; only its direction counts",
                **within((3,), -30, 30, lambda model: model.gravity, 0.1),
            ),
        ),
        "the robot's base is not level as the setup says",
        "level the base, or correct robot.gravity in the setup",
        transform=gravity_tilt,
        fit=Fitting(Linear(), told=_of_stated_size),
        check=lambda values: "" if values["gravity"].any() else "gravity without a direction",
        twins=(
            Twin("encoder_offset", False, "move joint 1 through half a turn: an offset of joint 2 turns with it"),
            Twin("mount_rotation", False, "turn the wrist: gravity stays in the world, the mounting in the sensor"),
        ),
        statement=angle("the base is tilted by {value} against the setup", "gravity"),
    ),
    Effect(
        "encoder_offset",
        "kinematics",
        (
            JOINT,
            Parameter("offset", "rad", "recorded minus true angle of the joint", (), -3.2, 3.2, 0.0, 0.0087),
        ),
        "an encoder's zero is shifted, so the arm is not in the pose the log says",
        "re-master the joint, or add the offset to its angles, if it is as large with another load",
        transform=encoder_offset,
        needs_motion="joints",
        fit=Fitting(ByJoint("joint", "offset")),
        twins=(
            Twin("none", True, "an offset of a joint whose axis is vertical cannot be seen in the wrench"),
            Twin("encoder_offset", False, "move the wrist: offsets of joints 4 and 6 or 2 and 4 look alike"),
            Twin("joint_flexibility", False, LOAD_IT),
            Twin("gravity_tilt", False, "move joint 1 through half a turn"),
            Twin("mount_rotation", True, "the last joint, when the sensor's and tool's axis is that joint's"),
        ),
        statement=amount("joint {joint:.0f} reads {value} deg too {sign}", "offset", DEGREES, ("much", "little")),
    ),
    Effect(
        "mount_translation",
        "kinematics",
        (
            Parameter(
                "translation",
                "m",
                "from the nominal to the true origin of the sensor, sensor axes",
                (3,),
                -1,
                1,
                0,
                0.02,
            ),
        ),
        "the sensor's origin is not where the setup says",
        "measure where the sensor sits on the flange and correct sensor.translation in the setup",
        transform=mount_translation,
        # An arm that rotates the sensor also accelerates it; if that is not recorded, it appears as another origin.
        needs_motion="acceleration",
        fit=Fitting(Linear(), unmeasured=lambda setup: not setup.sensor.translation.any()),
        twins=(
            Twin("none", False, "rotate the wrist fast: at rest the origin is unobservable"),
            Twin(
                "tool_com",
                False,
                "turn the wrist slowly, too: a wrong centre of mass shows in the torque of its weight",
            ),
        ),
        statement=distance(
            "the sensor sits {value} from where the setup puts it, mostly along {axis}", "translation", "mm", 1e3
        ),
    ),
)

MOUNTING = (
    Effect(
        "mount_rotation",
        "kinematics",
        (
            Parameter(
                "rotation", "rad", "rotation vector from nominal to true axes, sensor frame", (3,), -3.2, 3.2, 0, 0.017
            ),
            Parameter(
                "tool_turns",
                "1",
                "1 if the tool is turned with the sensor, 0 if it stays",
                **within((), 0, 1, 0, 0, optional=True),
            ),
        ),
        "the sensor is mounted turned against what the setup says",
        "re-measure the mounting and correct sensor.rotation_rpy in the setup",
        transform=tool_turns,
        reading=mount_rotation,
        fit=Fitting(Linear(((), (("tool_turns", 1.0),)))),
        twins=(
            Twin("encoder_offset", True, "about the last joint's axis, when sensor and tool are on that axis"),
            Twin("gravity_tilt", False, "turn the wrist through several directions of gravity"),
            Twin("crosstalk", False, "load single axes: a rotation mixes force with force only"),
        ),
        statement=distance(
            "the sensor is mounted {value} turned against the setup, mostly about {axis}", "rotation", "deg", DEGREES
        ),
    ),
)
"""Acts on the reading, after everything that happens at the tool."""
