"""Keys of the section log: how to find things in a recording."""

from __future__ import annotations

from ftbias_jax.setup.keys.key import PER_JOINT, Key, Kind, SectionKeys, names, text

LOG = SectionKeys(
    "How to find things in a log that does not use the usual names.",
    {
        "columns": Key(Kind.TABLE, "names of the columns of a CSV or Parquet file", absent="the usual names"),
        "topics": Key(Kind.TABLE, "topics, where a recording has several that fit", absent="found by type"),
    },
)
COLUMNS = SectionKeys(
    "Names of the columns of a CSV or Parquet file.",
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
    "Topics, where a recording has several that fit.",
    {
        "joints": text("topic of the joint states", absent="found by type", example="/joint_states"),
        "pose": text("topic of the sensor's pose", absent="found by type", example="/pose"),
        "wrench": text("topic of the wrench", absent="found by type", example="/wrench"),
    },
)
