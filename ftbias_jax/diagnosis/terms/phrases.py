"""Wording of the report for each drive and each form."""

from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.thresholds import SURE
from ftbias_jax.model.effects.terms.types import Term
from ftbias_jax.types import Array


class Words(NamedTuple):
    """Wording for a drive, whatever its form."""

    resembles: tuple[str, ...]
    check: str
    separate_by: str
    """Motion that distinguishes it from another drive."""


DRIVE_WORDS = {
    "constant": Words(
        ("wind or a fan", "a balancer or bungee", "a hanging cable", "a field"),
        "look for what pulls the tool in one direction of the room whatever the pose",
        "hold several wrist orientations at one place: a constant force keeps its direction in the room",
    ),
    "time": Words(
        ("material that is used up or collected", "drying or leaking", "a slow disturbance of the amplifier"),
        "weigh the tool before and after, and record a log at rest as long as this one",
        "repeat the same motion at different times after the start",
    ),
    "temperature": Words(
        ("warm gauges", "gauges whose gain depends on the temperature", "a warm side of the sensor", "a heated tool"),
        "record a log at rest while the sensor warms, and keep heat away from one side of it",
        "warm the sensor while the robot rests",
    ),
    "position": Words(
        ("a spring or hose fixed in the room", "a magnet", "a wall or brush at the edge of the workspace"),
        "look for what is near the tool where the plot rises",
        "visit the same places with other wrist orientations",
    ),
    "orientation": Words(
        (
            "a wrong mass, centre of mass or mounting beside other things",
            "a liquid or loose part in the tool",
            "a sagging hose",
            "a magnetic field",
            "a sensor that bends",
        ),
        "identify the tool anew, then turn the wrist slowly at one place and listen for what moves in it",
        "turn the wrist at one place, then move the arm with the wrist level",
    ),
    "velocity": Words(
        ("drag", "a damper", "a hose pulled along"),
        "look for what the tool pulls along or moves through",
        "repeat one path at half and at twice the speed, and with single joints",
    ),
    "angular_velocity": Words(
        ("a spinning spindle", "a viscous joint in the tool", "a hose that twists"),
        "stop what turns in the tool and record again",
        "turn the tool about each axis at the same place",
    ),
    "acceleration": Words(
        ("entrained air or liquid", "sloshing", "a part that swings", "a load that is not in the tool's model"),
        "tap the tool and watch what keeps swinging; empty tanks and record again",
        "accelerate along one line at several frequencies",
    ),
    "joint_angle": Words(
        ("a cable bundle wound about the joint", "cogging or a magnet near the joint", "a gearbox that pushes"),
        "move this joint alone, slowly, forth and back",
        "move this joint alone, and then the others with this one still",
    ),
    "joint_velocity": Words(
        ("a seal or a brush on the joint", "friction of a cable bundle", "heat of the motors"),
        "move this joint alone at several speeds, forth and back",
        "move this joint alone, and then the others with this one still",
    ),
    "load": Words(
        ("gauges that are not linear", "overload protection that touches", "a bent flexure"),
        "hang known weights on the sensor, and compare its readings with straight lines",
        "hang other weights on the tool and repeat the motion",
    ),
    "load_time": Words(
        ("an amplifier that ages or settles", "glue that creeps", "a load that changes with time"),
        "hang a known weight at the start and at the end",
        "weigh the tool at the start and at the end: a changed gain scales all axes, a changed mass does not",
    ),
    "frequency": Words(
        ("mains hum", "a fan, pump or motor", "a structure that rings", "a regulator of pressure or temperature"),
        "record at rest with motors, pumps and lamps on and off",
        "record at rest, and at a second sampling rate",
    ),
    "noise": Words(
        ("vibration of the drives", "a loose connector", "a worn gear"),
        "record at rest and at several speeds, and compare the scatter",
        "repeat the motion with another load and at another speed",
    ),
}

FORM_WORDS = {
    ("constant", "steady"): "that keeps its direction in the room",
    ("time", "exponential"): "that settles with a time constant of {time_constant:.3g} s",
    ("time", "linear"): "that grows by the second",
    ("time", "quadratic"): "that changes slowly with time",
    ("time", "step"): "that is there {spells}",
    ("time", "wave"): "that rises and falls with a period of {period:.3g} s",
    ("temperature", "linear"): "that follows the temperature",
    ("temperature", "quadratic"): "that follows the temperature and its square",
    ("temperature", "gradient"): "that follows the temperature late, with a time constant of {lag:.3g} s",
    ("temperature", "sensitivity"): "in proportion to the load and the temperature",
    ("temperature", "calibrated"): "in proportion to the load and to the temperature off {reference:.3g} deg C",
    ("temperature", "compensated"): "in proportion to the load and to the square of the temperature off "
    "{reference:.3g} deg C",
    ("position", "spring"): "of a spring between the tool and a place of the room",
    ("position", "attraction"): "towards the place ({x:.2f}, {y:.2f}, {z:.2f}) m, falling with power {power:.2g} of "
    "the distance (coefficient: at 0.5 m)",
    ("position", "barrier"): "that grows beyond a plane at {offset:.3g} m along ({x:.2f}, {y:.2f}, {z:.2f})",
    ("position", "surface"): "of a surface at {offset:.3g} m along ({x:.2f}, {y:.2f}, {z:.2f}), pressed and slid over",
    ("position", "linear"): "that depends on the place linearly",
    ("position", "quadratic"): "that depends on the place",
    ("orientation", "linear"): "that depends on the direction of gravity",
    ("orientation", "map"): "that depends on the direction of gravity as the sensor sees it",
    ("orientation", "field"): "that depends on how the sensor sees the direction ({x:.2f}, {y:.2f}, {z:.2f}) of the "
    "room",
    ("velocity", "linear"): "against the velocity of the tool",
    ("velocity", "quadratic"): "against the velocity of the tool, with the square of the speed",
    ("velocity", "cubic"): "against the velocity of the tool, with the third power of the speed",
    ("velocity", "coulomb"): "against the direction of motion of the tool, whatever the speed",
    ("velocity", "local"): "against the velocity of the tool within {radius:.2g} m of ({x:.2f}, {y:.2f}, {z:.2f}) m",
    ("angular_velocity", "linear"): "against the rotation of the tool",
    ("angular_velocity", "quadratic"): "against the rotation of the tool, with the square of the rate",
    ("angular_velocity", "coulomb"): "against the rotation of the tool, whatever the rate",
    ("angular_velocity", "gyroscopic"): "of a rotor in the tool, across its axis and the rotation",
    ("acceleration", "linear"): "against the acceleration of the tool, without a weight",
    ("acceleration", "swing"): "of a mass that swings at {frequency:.3g} Hz with damping {damping_ratio:.2g}",
    ("acceleration", "trailing"): "that follows the acceleration {lag:.2g} s late",
    ("acceleration", "payload"): "that is carried {spells}",
    ("acceleration", "turning"): "against the angular acceleration of the tool",
    ("joint_angle", "linear"): "in proportion to the angle of joint {joint}",
    ("joint_angle", "cubic"): "that grows with the angle of joint {joint}",
    ("joint_angle", "harmonic"): "that repeats {multiple:.3g} times in a turn of joint {joint}",
    ("joint_velocity", "viscous"): "against the speed of joint {joint}",
    ("joint_velocity", "friction"): "against the direction in which joint {joint} moves, whatever its speed",
    ("joint_velocity", "quadratic"): "against the speed of joint {joint}, with its square",
    ("joint_velocity", "heat"): "that follows the squared speed of {joints}, forgotten in {time_constant:.3g} s",
    ("load", "square"): "with the square of the load",
    ("load", "signed_square"): "with the square of the load and its sign",
    ("load", "cube"): "with the third power of the load",
    ("load", "size"): "with the size of the load",
    ("load_time", "linear"): "in proportion to the load, growing by the second",
    ("load_time", "exponential"): "in proportion to the load, settling in {time_constant:.3g} s",
    ("load_time", "wave"): "in proportion to the load, with a period of {period:.3g} s",
    ("load_time", "step"): "in proportion to the load, {spells}",
    ("frequency", "line"): "at {frequency:.5g} Hz",
    ("noise", "load"): "with the square of each channel's load",
    ("noise", "force"): "with the square of the force on the sensor",
    ("noise", "time"): "with time",
    ("noise", "acceleration"): "with the square of the tool's acceleration",
    ("noise", "speed"): "with the square of the tool's speed",
    ("noise", "joints"): "with the squares of the joints' speeds",
}
"""Action of each form, as a template for its parameters."""

LIKE = {
    ("velocity", "coulomb"): "dry friction",
    ("velocity", "linear"): "a damper",
    ("velocity", "quadratic"): "drag in a liquid",
    ("velocity", "local"): "something in the room that the tool brushes against",
    ("angular_velocity", "coulomb"): "dry friction",
    ("angular_velocity", "gyroscopic"): "a spindle",
    ("position", "spring"): "a hose or bungee",
    ("position", "attraction"): "a magnet",
    ("position", "barrier"): "a brush or wall",
    ("position", "surface"): "a table or workpiece",
    ("acceleration", "swing"): "sloshing",
    ("acceleration", "payload"): "a part that is gripped",
    ("time", "step"): "a jet of air, a motor or a magnet that is switched",
    ("joint_velocity", "heat"): "heat of the motors",
    ("joint_velocity", "friction"): "a seal that rubs",
}
"""What a form resembles most, if that differs from the first cause that its drive resembles."""
CHECK = {
    ("acceleration", "payload"): "weigh what is carried with ftbias identify --payloads, or on a scale",
    ("time", "step"): "look at what touched the tool or was switched near it then",
}
"""What to check for a form, if that differs from what to check for its drive."""
OF_A_SHIFT = ("a screw or clamp of the tool that slips", "fingers of a gripper that open and close", "a part gripped")
CHECK_OF_A_SHIFT = "look at what moved in the tool then, and tighten it"
SUBTRACTED = "a controller that subtracts the weight of a payload"
CHECK_OF_SUBTRACTED = "set the controller's payload to zero and record again, then tap the tool: what swings goes on"
SLOWEST = {"mains hum": 16.0, "a structure that rings": 2.0, "a fan, pump or motor": 0.2}
"""Hz, lowest frequency of each cause; railways have the lowest mains frequency, 16.7 Hz."""


FEW = 3
"""Number of intervals up to which they are listed one by one."""


def intervals_in_words(times: Array) -> str:
    """Intervals in words of something switched on and off alternately at the times (N,) s."""
    edges = np.ravel(times)
    lengths = np.diff(edges)[::2]
    if len(lengths) > FEW:
        return f"{(len(edges) + 1) // 2} times, {lengths.min():.2g} to {lengths.max():.2g} s each"
    words = [f"from {on:.4g} to {off:.4g} s" for on, off in zip(edges[::2], edges[1::2], strict=False)]
    words += [f"from {edges[-1]:.4g} s on"] if len(edges) % 2 else []
    return " and ".join(words)


def is_shift(term: Term, stderr: Array) -> bool:
    """Whether a load has a moment but no certain mass: then something in the tool moves, and nothing is gripped."""
    return term.form == "payload" and bool(np.all(np.abs(term.coefficients) < SURE * stderr))


def is_mass_without_weight(term: Term) -> bool:
    """Whether a term is the inertia of a mass of which the reading does not show the weight."""
    mass = np.asarray(term.coefficients)
    return (
        (term.drive, term.form, term.acts_as) == ("acceleration", "linear", "force") and mass.size == 1 and mass[0] > 0
    )


def shift(term: Term, size: str) -> str:
    """Headline of such a load, whose mass with its standard error is the ``size``."""
    return f"a shift of the tool's centre of mass {intervals_in_words(term.parameters['time'])}, with {size} more"


def check(term: Term, stderr: Array) -> str:
    """What to check first; a step that stays (a single time) is a change of the tool or of the amplifier."""
    if is_shift(term, stderr):
        return CHECK_OF_A_SHIFT
    if is_mass_without_weight(term):
        return CHECK_OF_SUBTRACTED
    stays = (term.drive, term.form) == ("time", "step") and np.size(term.parameters["time"]) == 1
    of_drive = DRIVE_WORDS[term.drive].check
    return of_drive if stays else CHECK.get((term.drive, term.form), of_drive)


def resembles(term: Term, stderr: Array) -> tuple[str, ...]:
    """Kinds of causes that look like a term with these standard errors of its coefficients, likeliest first."""
    if is_shift(term, stderr):
        return OF_A_SHIFT
    first = LIKE.get((term.drive, term.form))
    others = DRIVE_WORDS[term.drive].resembles
    if is_mass_without_weight(term):
        others = (SUBTRACTED, *others)
    if term.drive == "frequency":
        others = tuple(kind for kind in others if term.parameters["frequency"] >= SLOWEST.get(kind, 0.0))
    if (term.drive, term.form) == ("time", "step") and np.size(term.parameters["time"]) > 1:
        first, others = "something that touches the tool", (LIKE["time", "step"], *others)
    return others if first is None else (first, *(kind for kind in others if kind != first))
