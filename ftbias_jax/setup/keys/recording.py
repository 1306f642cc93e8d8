"""Keys of the section log: how to find things in a recording."""

from __future__ import annotations

from ftbias_jax.setup.fields import POSITIVE
from ftbias_jax.setup.keys.key import PER_JOINT, Key, Kind, SectionKeys, names, number, text
from ftbias_jax.setup.recorded import (
    ACCELERATION_UNITS,
    ANGLE_UNITS,
    FORCE_UNITS,
    RECEIPT,
    TIME_UNITS,
    TORQUE_UNITS,
    WRENCH_AXES,
)
from ftbias_jax.setup.recorded import CLOCKS as STAMPED_BY

LOG = SectionKeys(
    "How to read a log that does not use the usual names and units.",
    {
        "columns": Key(Kind.TABLE, "names of the columns of a CSV or Parquet file", absent="the usual names"),
        "topics": Key(Kind.TABLE, "topics, where a recording has several that fit", absent="found by type"),
        "clocks": Key(Kind.TABLE, "whose stamps each topic has", absent="found from the recording"),
        "files": Key(Kind.TABLE, "the files of one log, where every stream has its own", absent="one file"),
        "time_units": Key(Kind.TABLE, "units of the stamps of single files", absent="`time_unit` for all"),
        "time_offsets": Key(Kind.TABLE, "by how much clocks are late or early", absent="one clock"),
        "time_unit": text(
            "unit of the stamps", choices=tuple(TIME_UNITS), absent="s, or ns if they are integers", example="us"
        ),
        "rate": number("samples a second, instead of stamps", "Hz", within=POSITIVE, absent="stamps", example=1000.0),
        "angle_unit": text("unit of joints and rates", choices=ANGLE_UNITS, default=ANGLE_UNITS[0]),
        "acceleration_unit": text(
            "unit of an accelerometer", choices=ACCELERATION_UNITS, default=ACCELERATION_UNITS[0]
        ),
        "force_unit": text("unit of the recorded forces", choices=tuple(FORCE_UNITS), default="N"),
        "torque_unit": text("unit of the recorded torques", choices=tuple(TORQUE_UNITS), default="Nm"),
        "wrench_axes": text(
            "axes in which the wrench is recorded, about the sensor's origin",
            choices=WRENCH_AXES,
            default=WRENCH_AXES[0],
        ),
    },
)
COLUMNS = SectionKeys(
    "Names of the columns of a CSV or Parquet file, or of the arrays of an NPZ or HDF5 file, each a list of numbers.",
    {
        "time": text("column of the stamps", absent="`t` or `time`", example="stamp"),
        "position": names("columns of the joints' positions, or of the pose", PER_JOINT, absent="the usual names"),
        "velocity": names("columns of the velocities, or of an IMU", PER_JOINT, absent="the usual names"),
        "wrench": names("columns of force, then torque", 6, absent="`fx` to `tz`"),
        "temperature": text("column of the temperature", absent="`temperature`", example="T"),
    },
    further="column, or array of an NPZ or HDF5 file, that effects of your own see under this name",
)
TOPICS = SectionKeys(
    "Topics, where a recording has several that fit, and fields of messages of any type: `/topic:field.sub[0:6]`, "
    "several by commas.",
    {
        "joints": text("topic of the joint states", absent="found by type", example="/joint_states"),
        "pose": text("topic of the sensor's pose", absent="found by type", example="/pose"),
        "wrench": text(
            "topic of the wrench, or six numbers by their field", absent="found by type", example="/state:ft.data[0:6]"
        ),
        "imu": text(
            "topic of an IMU or accelerometer at the sensor, where a pose is recorded",
            absent='found by type with `linear = "specific_force"`',
            example="/imu",
        ),
        "temperature": text(
            "topic of the temperature, or a number by its field",
            absent="found by type, if there is one",
            example="/ft/temperature",
        ),
        "position": text(
            "field of the joints' positions in the setup's order, or of the pose", absent="none", example="/state:q"
        ),
        "velocity": text("field of the velocities, or of an IMU", absent="none", example="/state:dq"),
    },
)
CLOCKS = SectionKeys(
    "Whose stamps the messages of a topic have: of their `header`, or of their `receipt` by the recorder.",
    {
        name: text(
            f"of the topic of {name}", choices=STAMPED_BY, absent="the headers' if all have them", example=RECEIPT
        )
        for name in TOPICS.keys
    },
)
FILES = SectionKeys(
    "The files of one log, each with stamps of its own. A * stands for what the names share: LOG is any of the files.",
    {
        "position": text("file of the joints, or of the pose, of any format", absent="none", example="*_joints.csv"),
        "velocity": text("of their velocities, or of an IMU", absent="none", example="*_imu.csv"),
        "wrench": text("of the wrench", absent="none", example="*_wrench.csv"),
        "temperature": text("of the temperature", absent="none", example="*_temperature.csv"),
    },
)
TIME_UNITS_OF_FILES = SectionKeys(
    "Units of the stamps of single files, where those of [log.files] differ.",
    {
        name: text(f"of the file of {name}", choices=tuple(TIME_UNITS), absent="`log.time_unit`", example="us")
        for name in FILES.keys
    },
)
TIME_OFFSETS = SectionKeys(
    "Constants that are added to the stamps of a stream, or of a file of [log.files], where clocks differ.",
    {
        "position": number("of the joints, or of the pose", "s", absent="0", example=-0.5),
        "velocity": number("of velocities or an IMU with stamps of their own", "s", absent="0", example=0.002),
        "wrench": number("of the wrench", "s", absent="0", example=0.012),
        "temperature": number("of temperatures with stamps of their own", "s", absent="0", example=1.0),
    },
)
