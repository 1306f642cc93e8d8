"""One-sentence statements about effects that were found: a quantity, its unit, and what the setup states instead.

A statement is a function of the estimates of an effect's parameters. Entries of the catalogue use one of these forms.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.types import AXES, AXIS_UNITS, Array

USUAL = np.repeat([1.0, 0.04], 3)
"""N, Nm: forces and torques that count as equally large when channels are compared."""
SURE = 3.0
"""Number of standard errors above which a channel is mentioned, and within which channels count as equal."""
PERCENT, DEGREES = 100.0, 180 / np.pi


class Estimate(NamedTuple):
    """Estimate of one parameter; arrays of the parameter's shape."""

    value: Array
    stderr: Array
    """Standard error; NaN = unknown."""
    nominal: Array
    """Value that the setup states; NaN = none."""


Estimates = Mapping[str, Estimate]
Statement = Callable[[Estimates], str]


def _form(say: Callable[..., str]) -> Callable[..., Statement]:
    """Decorator of a form: called with its arguments apart from the estimates, it returns a statement."""
    return lambda *given, **named: lambda estimates: say(estimates, *given, **named)


def value_words(value: float, stderr: float) -> str:
    """A number with its standard error, both to the second digit of the error."""
    if not np.isfinite(stderr) or stderr <= 0 or not np.isfinite(value):
        return f"{value:.4g}"
    power = int(np.floor(np.log10(stderr)))
    if power >= -5 and max(abs(value), stderr) < 1e7:
        return f"{value:.{max(1 - power, 0)}f} ± {stderr:.{max(1 - power, 0)}f}"
    digits = max(int(np.floor(np.log10(max(abs(value), stderr)))) - power + 1, 1)
    return f"{value:.{digits}e} ± {stderr:.1e}"


@_form
def amount(
    estimates: Estimates, words: str, name: str, factor: float = 1.0, signs: tuple[str, str] | None = None
) -> str:
    """Scalar parameter times a factor: the words may have {value}, {setup} for what the setup states, and {sign}.

    With ``signs``, words for positive and for negative values, {value} is the magnitude; without, it keeps its sign.
    """
    value, stderr, nominal = (factor * float(np.asarray(x).ravel()[0]) for x in estimates[name])
    setup = f", the setup says {nominal:.4g}" if np.isfinite(nominal) else ""
    sign = "" if signs is None else signs[value < 0]
    return _filled(words, estimates, value=value_words(abs(value) if signs else value, stderr), setup=setup, sign=sign)


@_form
def distance(
    estimates: Estimates, words: str, name: str, unit: str, factor: float = 1.0, labels: Sequence[str] = "xyz"
) -> str:
    """Distance of a vector from what the setup states, or from zero: {value}, times a factor to be in the given unit.

    {axis} is the label of the axis along which it departs most.
    """
    value, stderr, nominal = estimates[name]
    away = factor * (value - np.where(np.isfinite(nominal), nominal, 0))
    length = max(float(np.linalg.norm(away)), 1e-300)
    error = factor * float(np.sqrt(np.sum((away / length * stderr) ** 2)))
    return words.format(value=f"{value_words(length, error)} {unit}", axis=labels[int(np.argmax(np.abs(away)))])


@_form
def angle(estimates: Estimates, words: str, name: str) -> str:
    """Angle between a vector and the one that the setup states, in degrees: {value} in the words."""
    value, stderr, nominal = estimates[name]
    between = np.arctan2(np.linalg.norm(np.cross(nominal, value)), nominal @ value)
    error = np.linalg.norm(stderr) / np.sqrt(2) / max(np.linalg.norm(value), 1e-300)
    return words.format(value=f"{value_words(float(np.degrees(between)), float(np.degrees(error)))} deg")


@_form
def channels(
    estimates: Estimates,
    words: str,
    name: str,
    neutral: float = 0.0,
    unit: str = "{unit}",
    factor: float = 1.0,
    exact: bool = False,
) -> str:
    """Parameter with one number per channel: the most significant force, or else torque, or all if they are equal.

    The words may have {value}, {channel}, {verb}, and {sign}: "much" above neutral or "little" below. ``unit``, to
    which ``factor`` converts, may have {unit} = N or Nm; ``exact`` values are given without a standard error.
    """
    value, stderr = (np.asarray(x, float).reshape(-1, len(AXES))[-1] for x in estimates[name][:2])
    away = np.where(np.isfinite(value), value - neutral, 0)
    size = np.where(stderr > 0, stderr, USUAL)
    sure = np.abs(away) > SURE * size if (stderr > 0).any() else away != 0
    preferred = sure & (USUAL[0] == USUAL) if sure[:3].any() else sure
    largest = int(np.argmax(np.where(preferred, np.abs(away) / size, -1)))
    spread = np.abs(away - away[largest]) / size
    which, verb, shown = AXES[largest], "reads", unit.format(unit=AXIS_UNITS[largest])
    if sure.all() and (spread < SURE).all() and unit == "%":
        which, verb = "all six channels", "read"
    elif sure.sum() > 1:
        others = "others" if sure.sum() > 2 else next(a for a in AXES if sure[AXES.index(a)] and a != which)
        alike = (np.sign(away[sure]) == np.sign(away[largest])).all()
        which, verb = (f"{which} and {others}", "read") if alike else (f"{which} ({others} differently)", verb)
    error = np.nan if exact else factor * float(stderr[largest])
    value_shown = value_words(factor * abs(float(away[largest])), error)
    sign = "much" if away[largest] > 0 else "little"
    return _filled(words, estimates, value=f"{value_shown} {shown}".rstrip(), channel=which, sign=sign, verb=verb)


@_form
def leak(estimates: Estimates, words: str, name: str) -> str:
    """Most significant off-diagonal entry of a matrix (6, 6): {value}, {source} and {target} in the words."""
    value, stderr = (np.asarray(x, float) for x in estimates[name][:2])
    size = np.abs(value - np.diag(np.diag(value)))
    surest = np.divide(size, stderr, out=np.zeros_like(size), where=stderr > 0)
    relative = size * USUAL / USUAL[:, None]
    row, column = np.unravel_index(int(np.argmax(surest if surest.any() else relative)), size.shape)
    same = AXIS_UNITS[row] == AXIS_UNITS[column]
    factor = PERCENT if same else 1.0
    shown = value_words(factor * float(value[row, column]), factor * float(stderr[row, column]))
    unit = "%" if same else f"{AXIS_UNITS[row]} per {AXIS_UNITS[column]}"
    return words.format(value=f"{shown} {unit}", source=AXES[column], target=AXES[row])


@_form
def events(estimates: Estimates, words: str, name: str, start: str) -> str:
    """Forces (N, 3) of temporary events: the largest, the number of events, and the start of the first."""
    sizes = np.linalg.norm(np.asarray(estimates[name].value, float).reshape(-1, 3), axis=1)
    begins = np.asarray(estimates[start].value, float).ravel()
    times = "once" if len(sizes) == 1 else f"{len(sizes)} times"
    first = f"{begins.min(initial=np.inf):.4g} s"
    return words.format(value=f"{sizes.max(initial=0.0):.3g} N", times=times, first=first)


@_form
def growth(estimates: Estimates, words: str, name: str) -> str:
    """Variance per squared speed (n, 6): largest standard deviation of a channel with all joints at 1 rad/s."""
    total = np.sqrt(np.nansum(np.asarray(estimates[name].value, float).reshape(-1, len(AXES)), 0))
    largest = int(np.argmax(total / USUAL))
    return words.format(value=f"{total[largest]:.2g} {AXIS_UNITS[largest]}", channel=AXES[largest])


def _filled(words: str, estimates: Estimates, **own: str) -> str:
    """The words filled with the first number of each parameter, by name, and with the fields of the form."""
    numbers = {name: float(np.ravel(x.value)[0]) for name, x in estimates.items() if np.size(x.value)}
    return words.format(**{**numbers, **own})
