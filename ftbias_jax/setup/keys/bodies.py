"""Keys of the sections that say where things are and what they weigh: robot, sensor, sensor_pose, tool."""

from __future__ import annotations

from ftbias_jax.setup.chains import CONVENTIONS, FIXED, UNITS
from ftbias_jax.setup.fields import NOT_NEGATIVE, POSITIVE
from ftbias_jax.setup.keys.key import PER_JOINT, SEVERAL, Key, Kind, SectionKeys, names, number, numbers, text
from ftbias_jax.setup.recorded import LINEAR, ORIENTATIONS, POSITION_AXES
from ftbias_jax.setup.robots import BUILT_IN, STANDARD_GRAVITY
from ftbias_jax.setup.types import COMPENSATED, REPORTS

ZERO = (0.0, 0.0, 0.0)

ROBOT = SectionKeys(
    "The arm: built in (`model`), from a URDF (`urdf`), a Denavit-Hartenberg table (`dh`), or a list of screws "
    "(`[[robot.joints]]` and `[robot.flange]`).",
    {
        "name": text("which robot of a fleet it is, for reports", absent="the model", example="cell 3"),
        "model": text("a built-in robot", choices=BUILT_IN, example="panda"),
        "urdf": text("a URDF file, from the setup's folder if the path is relative", example="arm.urdf"),
        "base_link": text("link of the URDF whose frame is the base frame", absent="the root", example="base"),
        "tip_link": text("link of the URDF that is the flange", absent="required with `urdf`", example="tool0"),
        "dh": Key(
            Kind.ROWS,
            "rows of a Denavit-Hartenberg table, `[a, alpha, d, theta]`, from the base to the flange; theta is what is "
            "added to the joint's angle; `\"fixed\"` at a row's end says that it has no joint",
            "as `dh_units` says",
            4,
            choices=("revolute", FIXED),
            absent="required without `model`, `urdf` and `joints`",
            example=((0.0, 1.5708, 0.0892, 0.0), (-0.425, 0.0, 0.0, 0.0)),
        ),
        "dh_convention": text(
            "where a row of `dh` has its joint: `standard`, theta and d come first, or `modified` (Craig), a and alpha",
            choices=CONVENTIONS,
            absent="required with `dh`",
            example="standard",
        ),
        "dh_units": text("units of the lengths and the angles of `dh`", choices=UNITS, default=UNITS[0]),
        "joints": Key(Kind.TABLES, "one table per joint", absent="required without `model`, `urdf` and `dh`"),
        "joint_names": names(
            "names of the joints of `model` or `dh` in recordings of ROS",
            PER_JOINT,
            absent="those of the maker's driver, or `joint1` and so on",
        ),
        "flange": Key(Kind.TABLE, "the flange in the base frame at q = 0", absent="required with `joints`"),
        "gravity": numbers("acceleration of gravity", "m/s^2, base frame", 3, default=STANDARD_GRAVITY),
    },
)
JOINT = SectionKeys(
    "One joint of a list of screws, base frame, at q = 0.",
    {
        "axis": numbers("unit vector along the axis", "base frame, q = 0", 3, required=True, example=(0.0, 0.0, 1.0)),
        "point": numbers("a point of the axis", "m", 3, absent="required if revolute", example=(0.0, 0.0, 0.3)),
        "type": text("what the joint does", choices=("revolute", "prismatic"), default="revolute"),
        "name": text("its name in recordings of ROS", absent="`joint1` and so on", example="shoulder"),
    },
    required=True,
)
FLANGE = SectionKeys(
    "The flange in the base frame at q = 0.",
    {
        "translation": numbers(
            "where its origin is", "m, pose at q = 0, base frame", 3, required=True, example=(0.0, 0.0, 0.7)
        ),
        "rotation_rpy": numbers("how it is turned", "rad, fixed axes", 3, default=ZERO),
    },
    required=True,
)
SENSOR = SectionKeys(
    "The force-torque sensor and how it is mounted.",
    {
        "name": text("which sensor of a fleet it is, for reports", absent="none", example="FT-0815"),
        "translation": numbers("where the sensor's origin is", "m, sensor origin in the flange frame", 3, default=ZERO),
        "rotation_rpy": numbers(
            "how the sensor's frame is turned: roll, pitch, yaw",
            "rad, fixed axes, in the flange frame",
            3,
            default=ZERO,
        ),
        "noise_std": numbers(
            "standard deviation of one sample: one number, two (force, torque) or six",
            "N, Nm",
            6,
            expand=True,
            within=POSITIVE,
            required=True,
            example=(0.1, 0.004),
        ),
        "reports": text(
            "`wrench_on_tool`, or `wrench_on_sensor` for a sensor that reports the opposite sign",
            choices=REPORTS,
            default=REPORTS[0],
        ),
        "compensated": text(
            "what the controller has subtracted from the reading already: `weight` of the payload, or all that the "
            "`tool` causes (`true` means the same); the corrected wrench is then what else acts on the tool",
            choices=COMPENSATED,
            default=COMPENSATED[0],
        ),
        "rezeroed": Key(
            Kind.FLAG,
            "the sensor was set to zero in the log's first pose, at rest and with the tool on: the bias starts at the "
            "tool's wrench there, beside `bias.initial`",
            default=False,
        ),
        "rezeroed_at": numbers(
            "when the sensor was set to zero while the log was recorded: the bias may jump there",
            "s, stamps of the log, as `check` finds them",
            SEVERAL,
            expand=True,
            absent="never",
            example=(12.345,),
        ),
        "correlated_std": numbers(
            "standard deviation of noise that is correlated in time: a first-order Gauss-Markov process on each axis",
            "N, Nm",
            6,
            expand=True,
            within=NOT_NEGATIVE,
            absent="from the log",
            example=(0.05, 0.002),
        ),
        "correlated_time": numbers(
            "its correlation time", "s", 6, expand=True, within=POSITIVE, absent="from the log", example=(0.2,)
        ),
    },
    required=True,
)
SENSOR_POSE = SectionKeys(
    "For logs with the pose of the sensor's mount instead of joints. `[robot]` then has `gravity` alone.",
    {
        "orientation": text(
            "how the orientation is recorded; any sign; NaN or zeros = not measured",
            choices=ORIENTATIONS,
            default=ORIENTATIONS[0],
        ),
        "linear": text(
            "how the acceleration is known: `position`, `specific_force` of an accelerometer at the sensor, or `none`",
            choices=LINEAR,
            default=LINEAR[0],
        ),
        "orientation_noise_std": number("noise of the orientation", "rad", within=POSITIVE, default=1e-4),
        "position_noise_std": number("noise of the position", "m", within=POSITIVE, default=1e-4),
        "angular_velocity_noise_std": number("noise of a gyroscope", "rad/s", within=POSITIVE, default=1e-2),
        "linear_velocity_noise_std": number("noise of the linear velocity", "m/s", within=POSITIVE, default=1e-2),
        "acceleration_std": number(
            'with `linear = "none"`: the accelerations that are not seen, which count as noise',
            "m/s^2",
            within=NOT_NEGATIVE,
            default=0.3,
        ),
        "conjugate": Key(
            Kind.FLAG, "the orientation is recorded the other way round: of the base frame in the body", default=False
        ),
        "position_axes": text("axes of the recorded position", choices=POSITION_AXES, default=POSITION_AXES[0]),
        "gyroscope": Key(Kind.FLAG, "use a recorded angular velocity", default=True),
        "imu_rotation_rpy": numbers(
            "how the axes of the IMU are turned", "rad, fixed axes, in the sensor's frame", 3, default=ZERO
        ),
        "frame": text("frame of TF that the sensor is mounted on", absent="a topic of PoseStamped", example="tool0"),
        "base": text("frame of TF that is the base", absent="the root", example="base"),
    },
)
TOOL = SectionKeys(
    "Everything distal of the sensor, as one rigid body. `info`, `check` and `identify` do without mass and centre.",
    {
        "mass": number("mass", "kg", within=POSITIVE, absent="not known", example=0.7),
        "center_of_mass": numbers("centre of mass", "m, sensor frame", 3, absent="not known", example=(0.0, 0.0, 0.06)),
        "inertia": numbers(
            "moments and products of inertia; zeros are a point mass",
            "kg m^2: Ixx Ixy Ixz Iyy Iyz Izz about the centre of mass, sensor axes",
            6,
            default=(0.0,) * 6,
        ),
        "mass_std": number(
            "standard error of the mass, which the error bars of `filter` then contain",
            "kg",
            within=POSITIVE,
            absent="the mass is known",
            example=0.02,
        ),
        "center_of_mass_std": numbers(
            "standard errors of the centre of mass, which the error bars of `filter` then contain",
            "m",
            3,
            expand=True,
            within=POSITIVE,
            absent="the centre is known",
            example=0.002,
        ),
        "from_urdf_link": text(
            "a link of `robot.urdf`, fixed to the tip, whose inertia is taken instead of the other keys",
            absent="the other keys",
            example="hand",
        ),
    },
)
