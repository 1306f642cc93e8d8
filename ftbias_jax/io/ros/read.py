"""Reading of logs from ROS 1 and ROS 2 recordings: topics are found by type, joints are matched by name."""

import os

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.check import Part, log_of_parts, on_one_clock
from ftbias_jax.io.log import Log, Repair
from ftbias_jax.io.ros.choose import Chosen, choose, refuse_columns, wanted_of
from ftbias_jax.io.ros.messages import JOINTS, WRENCH
from ftbias_jax.io.ros.record import Recording, Stream, read_recording
from ftbias_jax.io.stamps.clock import complaint_of_headers, continue_after_jumps, jumps, rate_against, tidy
from ftbias_jax.setup.recorded import HEADER, RECEIPT
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

CREDIBLE_DELAY = 10**10
"""ns; largest deviation of a message's delay from the median that is credible in a damaged recording."""
RATE_STDERRS, LEAST_RATE = 5.0, 20.0
"""Standard errors and ppm from which a clock's rate is reported; any two quartz oscillators differ by a few ppm."""


def read_ros(path: str | os.PathLike[str], setup: Setup, *, salvage: bool = False) -> Log:
    """Read a ROS 1 bag, or a ROS 2 bag: its folder, or a ``.db3`` or ``.mcap`` file.

    If the setup has a sensor_pose, the pose comes from a topic of geometry_msgs/PoseStamped, or from TF. Otherwise the
    joints come from all publishers of one topic of sensor_msgs/JointState; messages about other joints, such as a
    gripper's, are ignored. The wrench comes from one topic of geometry_msgs/WrenchStamped. ``messages`` lists the other
    known types. [log.topics] selects among several topics, and may name any field of any type; [log.clocks] selects the
    stamps. ``salvage`` skips damaged parts.
    """
    refuse_columns(setup, setup.log.columns, os.fspath(path))
    return log_of(read_recording(path, salvage=salvage, wanted=wanted_of(setup)), setup, os.fspath(path))


def log_of(recording: Recording, setup: Setup, file: str = "") -> Log:
    """Build the log from a recording that has already been read; see ``read_ros``."""
    mended: list[Repair] = []
    recording = credible(recording, mended)
    chosen = choose(recording, ("position", "velocity", "wrench", "temperature"), setup, file)
    parts = on_one_clock(parts_of(chosen, setup, mended, file), setup.log, file)
    log = log_of_parts(parts, setup, tuple(mended), file)
    return log._replace(frame=chosen["wrench"][1].names[0])


def parts_of(chosen: Chosen, setup: Setup, mended: list[Repair], file: str = "") -> list[Part]:
    """Streams as arrays of a log, sorted and with comparable stamps; the necessary repairs are added to ``mended``."""
    timed = _stamped(chosen, setup, mended, file)
    known = {name: t != 0 for name, t in timed.items()}
    main = _main(chosen)
    stamps, back = continue_after_jumps([timed[name][known[name]] for name in main], file)
    if back:
        mended.append(Repair(f"the clock jumps back ({back} in all): what follows is put 1 s after what was before"))
    in_time = dict(zip(main, stamps, strict=True))
    for name in timed.keys() - in_time.keys():
        t = timed[name][known[name]]
        if back or len(jumps(t)):
            mended.append(Repair(f"the {name} is left out, because the clock jumps back", lost=True))
        else:
            in_time[name] = t
    parts: list[Part] = []
    for name, t in in_time.items():
        role, stream = chosen[name]
        ordered = tidy(t, {name: stream.values[known[name]]}, f"samples of {stream.topic}")
        mended.extend(ordered.repairs)
        if lost := int((~known[name]).sum()):
            mended.append(Repair(f"{lost} of the samples of {stream.topic} left out: they have no stamp", lost=True))
        values = ordered.columns[name]
        arrays = {name: values[:, 0] if name == "temperature" else values}
        if role == JOINTS:
            n = values.shape[1] // 2
            # Joint messages hold velocities too; a stream that the setup names takes precedence.
            arrays = {"q": values[:, :n]} | ({} if "dq" in chosen else {"dq": values[:, n:]})
        parts.append((ordered.t, arrays))
    return parts


def _main(chosen: Chosen) -> list[str]:
    """Streams that decide which clock is used; not temperatures, which change slowly and are recorded by any device."""
    return [name for name in chosen if name != "temperature"] or list(chosen)


def _stamped(chosen: Chosen, setup: Setup, mended: list[Repair], file: str) -> dict[str, Array]:
    """Stamps (T,) ns of every stream, from its headers or from the recorder; 0 = unknown."""
    main = _main(chosen)
    streams = {name: stream for name, (_, stream) in chosen.items()}
    stated = {name: setup.log.clocks.get(role, "") for name, (role, _) in chosen.items()}
    used = [streams[name] for name in main]
    complaint = complaint_of_headers([stream.stamps for stream in used], [stream.logged for stream in used])
    if complaint and not all(stated[name] for name in main):
        mended.append(Repair(f"{complaint}: times of the recorder used; {', '.join(map(skew, used))}"))
    timed = {}
    for name, stream in streams.items():
        timed[name] = stream.stamps if not complaint and stream.stamps.any() else stream.logged
        if stated[name]:
            timed[name] = {HEADER: stream.stamps, RECEIPT: stream.logged}[stated[name]]
        if not timed[name].any():
            field = f"log.clocks.{chosen[name][0]}"
            raise LogError(f"{stream.topic} has no stamps in its headers", file=file, field=field, remedy='"receipt"')
    return timed


def credible(recording: Recording, mended: list[Repair]) -> Recording:
    """Remove samples of a damaged recording whose stamps or frames may be due to a flipped bit."""
    mended += [Repair(damage, lost=True) for damage in recording.damage]
    if not recording.damage:
        return recording
    wrenches = [stream for stream in recording.streams if stream.role == WRENCH]
    kept = []
    for stream in recording.streams:
        most = max((len(other.stamps) for other in wrenches if other.topic == stream.topic), default=0)
        late = stream.logged - stream.stamps
        credible = np.abs(late - np.median(late)) < CREDIBLE_DELAY
        if stream.role == WRENCH and len(stream.stamps) < most / 2:
            credible = np.zeros_like(credible)
        if credible.any():
            kept.append(stream.at(credible))
        if not credible.all():
            what = f"{(~credible).sum()} of the samples of {stream.topic} left out"
            mended.append(Repair(f"{what}: their stamp or frame is not credible", lost=True))
    mended.append(Repair(f"{sum(topic.messages for topic in recording.topics)} messages were recovered"))
    return recording._replace(streams=tuple(kept))


def skew(stream: Stream) -> str:
    """Offset of the recorder's clock from the clock of a stream's headers, and how fast the latter runs, in words."""
    stamped = stream.stamps != 0
    if not stamped.any():
        return f"{stream.topic} has no stamps"
    ahead = np.median((stream.logged - stream.stamps)[stamped]) * 1e-9
    words = f"{stream.topic} was recorded {abs(ahead):.3g} s {'after' if ahead >= 0 else 'before'} its stamps"
    rate, stderr = rate_against(*(times[stamped] for times in (stream.stamps, stream.logged)))
    if abs(rate) < RATE_STDERRS * stderr or abs(rate) < LEAST_RATE:
        return words
    sign = "fast" if rate > 0 else "slow"
    return f"{words}, whose clock runs {abs(rate):.3g} ± {stderr:.1g} ppm {sign} against the recorder's"
