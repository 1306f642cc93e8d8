"""Table of the forms in which each drive may act, each with its series over a log, for NumPy and JAX alike.

A form yields scalars (T, S), which act along three axes or on six channels; or vectors (T, V, 3) in base axes, which
act along their own directions; or (T, 6) for channels, each of which acts on itself.
"""

from typing import Any

from ftbias_jax.model.effects.responses import decay_time, low_passed, swing
from ftbias_jax.model.effects.terms.types import Form, Make, Numbers, Parameter, State
from ftbias_jax.types import Array

TAU = Parameter("time_constant", "s", 0.1, 1e5)
LAG = Parameter("lag", "s", 0.0, 1e4)
REFERENCE = Parameter("reference", "deg C", -100.0, 300.0)
TIME = Parameter("time", "s", 0.0, 1e7, several=True)
TAKES = Parameter("takes", "s", 0.0, 1.0)
FREQUENCY = Parameter("frequency", "Hz", 1e-4, 1e4)
SPEED = Parameter("speed", "m/s", 1e-3, 2.0)
CREEP = 0.02
"""m/s below which dry friction in one place falls smoothly to zero."""
TURN = Parameter("speed", "rad/s", 1e-3, 5.0)
PLACE = tuple(Parameter(axis, "m", -10.0, 10.0) for axis in "xyz")
NORMAL = tuple(Parameter(axis, "1", -1.5, 1.5) for axis in "xyz")
FIELD = (*PLACE, Parameter("power", "1", 0.2, 8.0), Parameter("core", "m", 0.0, 1.0))
REGION = (*PLACE, Parameter("radius", "m", 0.005, 5.0), Parameter("edge", "m", 0.001, 2.0))
PLANE = (*NORMAL, Parameter("offset", "m", -10, 10), Parameter("length", "m", 0.005, 5.0))
SWING = (Parameter("frequency", "Hz", 0.05, 30.0), Parameter("damping_ratio", "1", 0.001, 0.95))

XYZ = ("x", "y", "z")
WAVES = ("sin", "cos")
MAP = (*XYZ, "xx_yy", "zz", "xy", "xz", "yz", "size_x", "size_y", "size_z")


def _decay(xp: Any, s: State, p: Numbers) -> Array:
    """A constant, and an exponential decay."""
    return xp.stack([xp.ones_like(s.t), xp.exp(-s.t / p["time_constant"])], 1)


def _step(xp: Any, s: State, p: Numbers) -> Array:
    """(T, 1) that is 1 from the first time to the second, from the third to the fourth and so on, in means of samples.

    A change that takes ``takes`` s is a linear ramp centred at its time.
    """
    times = xp.atleast_1d(p["time"])
    length = (xp.where(s.counts > 1, s.counts * s.period, 0.0) + p.get("takes", 0.0))[:, None]
    since = s.t[:, None] - times[None]
    after = xp.where(length > 0, xp.clip(0.5 + since / xp.where(length > 0, length, 1.0), 0, 1), since >= 0)
    return (after * (-1.0) ** xp.arange(len(times))[None]).sum(1, keepdims=True)


def _payload(xp: Any, s: State, p: Numbers) -> Array:
    """Weight and inertial force of a unit mass at the point, while it is carried."""
    return (_step(xp, s, p) * (s.gravity[None] - s.acceleration))[:, None]


def _load_settling(xp: Any, s: State, p: Numbers) -> Array:
    """The reading times an exponential that settles with a time constant."""
    return s.load * xp.expm1(-s.t / p["time_constant"])[:, None]


def _vector(xp: Any, p: Numbers) -> Array:
    return xp.stack([p["x"], p["y"], p["z"]])


def _waves(xp: Any, angle: Array) -> Array:
    return xp.stack([xp.sin(angle), xp.cos(angle)], 1)


def _wave(xp: Any, s: State, p: Numbers) -> Array:
    return _waves(xp, 2 * xp.pi * p["frequency"] * s.t)


def _line(xp: Any, s: State, p: Numbers) -> Array:
    """A sine and a cosine, attenuated as they are in means of evenly spaced samples."""
    step = xp.pi * p["frequency"] * s.period
    fast = xp.abs(xp.sin(step)) > 1e-6
    left = xp.where(fast, xp.sin(s.counts * step) / (s.counts * xp.where(fast, xp.sin(step), 1.0)), 1.0)
    return _wave(xp, s, p) * left[:, None]


def _felt(xp: Any, s: State, p: Numbers) -> Array:
    """Temperature (T, 1) after a first-order lag."""
    return low_passed(xp, s.t, s.temperature[:, None], p["lag"])


def _warmer(xp: Any, s: State, p: Numbers) -> Array:
    """Lagged temperature relative to the first sample."""
    felt = _felt(xp, s, p)
    return felt - felt[:1]


def _warmer_squared(xp: Any, s: State, p: Numbers) -> Array:
    warmer = _warmer(xp, s, p)
    return xp.concatenate([warmer, warmer**2], 1)


def _warming_side(xp: Any, s: State, p: Numbers) -> Array:
    """Temperature of a part that lags the thermometer, and its difference from the thermometer, which is a gradient."""
    felt = _warmer(xp, s, p)
    return xp.concatenate([felt, (s.temperature - s.temperature[0])[:, None] - felt], 1)


def _calibrated(power: int) -> Make:
    """Minus the load times a power of the difference from the temperature of the calibration."""
    return lambda xp, s, p: -((_felt(xp, s, p) - p["reference"]) ** power) * s.load


def _spring(xp: Any, s: State, p: Numbers) -> Array:
    """Minus the position of the point, and the three axes of the base."""
    axes = xp.broadcast_to(xp.eye(3, dtype=s.position.dtype), (*s.position.shape, 3))
    return xp.concatenate([-s.position[:, None], axes], 1)


def _attraction(xp: Any, s: State, p: Numbers) -> Array:
    """Vector towards a place that falls with a power of the distance beyond a core; 1 at half a metre."""
    away = _vector(xp, p)[None] - s.position
    distance = xp.sqrt((away**2).sum(1, keepdims=True) + p["core"] ** 2 + 1e-6)
    return (away / distance * (0.5 / distance) ** p["power"])[:, None]


def _barrier(xp: Any, s: State, p: Numbers) -> Array:
    """A force that grows with the distance beyond a plane, with a soft onset over a length."""
    normal = _vector(xp, p)
    beyond = (s.position @ normal) / xp.sqrt(normal @ normal + 1e-12) - p["offset"]
    return xp.logaddexp(0.0, beyond / p["length"])[:, None] * p["length"]


def _surface(xp: Any, s: State, p: Numbers) -> Array:
    """Contact with a plane: a normal force proportional to the depth, and proportional friction against sliding."""
    normal = _vector(xp, p)
    normal = normal / xp.sqrt(normal @ normal + 1e-12)
    depth = _barrier(xp, s, p)
    along = s.velocity - (s.velocity @ normal)[:, None] * normal[None]
    speed = xp.sqrt((along**2).sum(1, keepdims=True) + CREEP**2)
    return xp.stack([-depth * normal[None], -depth * along / speed], 1)


def _place_squared(xp: Any, s: State, p: Numbers) -> Array:
    x, y, z = s.position.T
    return xp.stack([x, y, z, x * x, y * y, z * z, x * y, x * z, y * z], 1)


def _seen(xp: Any, s: State, direction: Array) -> Array:
    """Direction (T, 3) of a vector of the base frame, in sensor axes."""
    return xp.einsum("tij,i->tj", s.rotation, direction) / xp.sqrt(direction @ direction + 1e-12)


def _map(xp: Any, s: State, direction: Array) -> Array:
    """Linear, quadratic and absolute-value functions of a direction in sensor axes."""
    x, y, z = _seen(xp, s, direction).T
    second = (x * x - y * y, 3 * z * z - 1, x * y, x * z, y * z)
    return xp.stack([x, y, z, *second, xp.abs(x), xp.abs(y), xp.abs(z)], 1)


def _along(field: str, power: int = 1) -> Make:
    """Vector opposite to one of the state, with a power of its length."""

    def make(xp: Any, s: State, p: Numbers) -> Array:
        vectors: Array = getattr(s, field)
        length = xp.sqrt((vectors**2).sum(-1, keepdims=True) + 1e-12)
        return (-vectors * length ** (power - 1))[:, None]

    return make


def _dry(field: str) -> Make:
    """Direction opposite to a vector of the state, which falls smoothly to zero below a speed."""

    def make(xp: Any, s: State, p: Numbers) -> Array:
        vectors: Array = getattr(s, field)
        return (-vectors / xp.sqrt((vectors**2).sum(-1, keepdims=True) + p["speed"] ** 2))[:, None]

    return make


def _local(xp: Any, s: State, p: Numbers) -> Array:
    """Viscous and dry friction within a radius of a place, with a soft edge."""
    away = s.position - _vector(xp, p)[None]
    distance = xp.sqrt((away**2).sum(1, keepdims=True) + 1e-12)
    inside = 0.5 - 0.5 * xp.tanh((distance - p["radius"]) / p["edge"])
    speed = xp.sqrt((s.velocity**2).sum(1, keepdims=True) + CREEP**2)
    return xp.stack([-inside * s.velocity, -inside * s.velocity / speed], 1)


def _gyroscopic(xp: Any, s: State, p: Numbers) -> Array:
    """Torque -omega x h of a rotor on the tool, for unit angular momenta h fixed in the tool along each sensor axis."""
    return -xp.cross(s.angular_velocity[:, None], xp.swapaxes(s.rotation, 1, 2))


def _swinging(xp: Any, s: State, p: Numbers) -> Array:
    """Response of a unit mass on spring and damper to the acceleration, beyond that of a rigid mass."""
    return -swing(xp, s.t, s.acceleration - s.gravity[None], p["frequency"], p["damping_ratio"])[:, None]


def _trailing(xp: Any, s: State, p: Numbers) -> Array:
    """Part of the acceleration that a first-order lag removes."""
    return (s.acceleration - low_passed(xp, s.t, s.acceleration, p["lag"]))[:, None]


def _cubic(xp: Any, s: State, p: Numbers) -> Array:
    return xp.concatenate([s.q, s.q**2, s.q**3], 1)


def _harmonic(xp: Any, s: State, p: Numbers) -> Array:
    return _waves(xp, p["multiple"] * s.q[:, 0])


def _heat(xp: Any, s: State, p: Numbers) -> Array:
    """Heat from the squared speed of one joint or of all, dissipated with a time constant."""
    power = (s.dq**2).sum(1, keepdims=True)
    power = xp.concatenate([xp.zeros_like(power[:1]), power[1:]])
    return p["time_constant"] * low_passed(xp, s.t, power, p["time_constant"])


def _squares(field: str, most: int | None = None) -> Make:
    """Squared length of a vector of the state, or of its first ``most`` numbers, for every channel."""
    return lambda xp, s, p: xp.broadcast_to((getattr(s, field)[:, :most] ** 2).sum(1)[:, None], (len(s.t), 6))


FORMS = {
    (form.drive, form.name): form
    for form in (
        Form("constant", "steady", "scalars", "1", lambda xp, s, p: xp.ones_like(s.t)[:, None]),
        Form("time", "exponential", "scalars", "1", _decay, (TAU,), ("offset", "decaying")),
        Form("time", "linear", "scalars", "s", lambda xp, s, p: s.t[:, None]),
        Form("time", "step", "scalars", "1", _step, (TIME,)),
        Form("time", "wave", "scalars", "1", _wave, (FREQUENCY,), WAVES),
        Form("time", "quadratic", "scalars", "s", lambda xp, s, p: xp.stack([s.t, s.t**2], 1), (), ("t", "t2")),
        Form("temperature", "linear", "scalars", "K", _warmer, (LAG,)),
        Form("temperature", "quadratic", "scalars", "K", _warmer_squared, (LAG,), ("linear", "squared")),
        Form("temperature", "gradient", "scalars", "K", _warming_side, (LAG,), ("late", "difference")),
        Form("temperature", "sensitivity", "channels", "K", lambda xp, s, p: -_warmer(xp, s, p) * s.load, (LAG,)),
        Form("temperature", "calibrated", "channels", "K", _calibrated(1), (LAG, REFERENCE)),
        Form("temperature", "compensated", "channels", "K^2", _calibrated(2), (LAG, REFERENCE)),
        Form("position", "spring", "vectors", "m", _spring, (), ("stiffness", *XYZ)),
        Form("position", "attraction", "vectors", "1", _attraction, FIELD),
        Form("position", "barrier", "scalars", "m", _barrier, PLANE),
        Form("position", "surface", "vectors", "m", _surface, PLANE, ("pressed", "sliding")),
        Form("position", "linear", "scalars", "m", lambda xp, s, p: s.position, (), XYZ),
        Form("position", "quadratic", "scalars", "m", _place_squared, (), (*XYZ, "xx", "yy", "zz", "xy", "xz", "yz")),
        Form("orientation", "linear", "scalars", "1", lambda xp, s, p: _seen(xp, s, s.gravity), (), XYZ),
        Form("orientation", "map", "scalars", "1", lambda xp, s, p: _map(xp, s, s.gravity), (), MAP),
        Form("orientation", "field", "scalars", "1", lambda xp, s, p: _map(xp, s, _vector(xp, p)), NORMAL, MAP),
        Form("velocity", "linear", "vectors", "m/s", _along("velocity")),
        Form("velocity", "quadratic", "vectors", "(m/s)^2", _along("velocity", 2)),
        Form("velocity", "cubic", "vectors", "(m/s)^3", _along("velocity", 3)),
        Form("velocity", "coulomb", "vectors", "1", _dry("velocity"), (SPEED,)),
        Form("velocity", "local", "vectors", "m/s", _local, REGION, ("viscous", "dry")),
        Form("angular_velocity", "linear", "vectors", "rad/s", _along("angular_velocity")),
        Form("angular_velocity", "quadratic", "vectors", "(rad/s)^2", _along("angular_velocity", 2)),
        Form("angular_velocity", "coulomb", "vectors", "1", _dry("angular_velocity"), (TURN,)),
        Form("angular_velocity", "gyroscopic", "vectors", "rad/s", _gyroscopic, (), XYZ),
        Form("acceleration", "linear", "vectors", "m/s^2", _along("acceleration")),
        Form("acceleration", "swing", "vectors", "m/s^2", _swinging, SWING, forgets=lambda p: decay_time(**p)),
        Form("acceleration", "trailing", "vectors", "m/s^2", _trailing, (LAG,), forgets=lambda p: p["lag"]),
        Form("acceleration", "payload", "vectors", "m/s^2", _payload, (TIME, TAKES)),
        Form("acceleration", "turning", "vectors", "rad/s^2", _along("angular_acceleration")),
        Form("joint_angle", "linear", "scalars", "rad", lambda xp, s, p: s.q),
        Form("joint_angle", "cubic", "scalars", "rad", _cubic, (), ("q", "q2", "q3")),
        Form("joint_angle", "harmonic", "scalars", "1", _harmonic, (Parameter("multiple", "1", 0.3, 200.0),), WAVES),
        Form("joint_velocity", "viscous", "scalars", "rad/s", lambda xp, s, p: -s.dq),
        Form("joint_velocity", "friction", "scalars", "1", lambda xp, s, p: -xp.tanh(s.dq / p["speed"]), (TURN,)),
        Form("joint_velocity", "quadratic", "scalars", "(rad/s)^2", lambda xp, s, p: -s.dq * xp.abs(s.dq)),
        Form("joint_velocity", "heat", "scalars", "rad^2/s", _heat, (TAU,)),
        Form("load", "square", "channels", "N, Nm", lambda xp, s, p: -(s.load**2)),
        Form("load", "signed_square", "channels", "N, Nm", lambda xp, s, p: -s.load * xp.abs(s.load)),
        Form("load", "cube", "channels", "N^2, Nm^2", lambda xp, s, p: -(s.load**3)),
        Form("load", "size", "channels", "1", lambda xp, s, p: -xp.abs(s.load)),
        Form("load_time", "linear", "channels", "s", lambda xp, s, p: -s.load * s.t[:, None]),
        Form("load_time", "exponential", "channels", "1", _load_settling, (TAU,)),
        Form("load_time", "wave", "channels", "1", lambda xp, s, p: -s.load * _wave(xp, s, p)[:, :1], (FREQUENCY,)),
        Form("load_time", "step", "channels", "1", lambda xp, s, p: -s.load * _step(xp, s, p), (TIME,)),
        Form("frequency", "line", "scalars", "1", _line, (FREQUENCY,), WAVES),
        Form("noise", "load", "channels", "N^2, Nm^2", lambda xp, s, p: s.load**2),
        Form("noise", "force", "channels", "N^2", _squares("load", 3)),
        Form("noise", "time", "channels", "s", lambda xp, s, p: xp.broadcast_to(s.t[:, None], (len(s.t), 6))),
        Form("noise", "acceleration", "channels", "(m/s^2)^2", _squares("acceleration")),
        Form("noise", "speed", "channels", "(m/s)^2", _squares("velocity")),
        Form("noise", "joints", "channels", "(rad/s)^2", _squares("dq")),
    )
}
"""(drive, name of the form) -> form."""
DRIVES = tuple(dict.fromkeys(drive for drive, _ in FORMS))
