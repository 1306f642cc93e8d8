"""Sine and versine in vector instructions, whereas XLA calls the scalar function of the C library for every sine.

Both follow from half the angle h = x / 2, reduced to r = h - k pi / 2 within 45 degrees (Cody and Waite 1980), by the
polynomials of fdlibm. A half turn of h changes neither 2 sin h cos h nor 2 sin^2 h, so only the parity of k matters.
"""

from collections.abc import Sequence
from functools import reduce

import jax
import jax.numpy as jnp
from jax import Array

HALF_PI = {
    "float64": (1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21),
    "float32": (1.5703125, 4.837512969970703125e-4, 7.54978995489188216e-8),
}
"""pi / 2 in parts, of which the first ones are short: k times them is exact up to 3e6 rad, in float32 up to 2e5 rad."""
SINE = (
    1.58969099521155010221e-10,
    -2.50507602534068634195e-08,
    2.75573137070700676789e-06,
    -1.98412698298579493134e-04,
    8.33333333332248946124e-03,
    -1.66666666666666324348e-01,
)
"""Coefficients of (sin r - r) / r^3 in powers of r^2, the highest first."""
COSINE = (
    -1.13596475577881948265e-11,
    2.08757232129817482790e-09,
    -2.75573143513906633035e-07,
    2.48015872894767294178e-05,
    -1.38888888888741095749e-03,
    4.16666666666666019037e-02,
)
"""Coefficients of (cos r - 1 + r^2 / 2) / r^4 in powers of r^2, the highest first."""


@jax.custom_jvp
def sine_and_versine(x: Array) -> tuple[Array, Array]:
    """sin x and 1 - cos x, the latter without cancellation; x in rad, any shape."""
    high, middle, low = HALF_PI[jnp.dtype(x.dtype).name]
    k = jnp.round(x / jnp.pi)
    r = ((x / 2 - k * high) - k * middle) - k * low
    odd = k - 2 * jnp.floor(k / 2) > 0
    square = r * r
    sine = r + r * square * _polynomial(SINE, square)
    cosine = 1 - square / 2 + square * square * _polynomial(COSINE, square)
    twice = 2 * sine * cosine
    return jnp.where(odd, -twice, twice), 2 * jnp.where(odd, cosine, sine) ** 2


@sine_and_versine.defjvp
def _slopes(primals: tuple[Array], tangents: tuple[Array]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    (x,), (along,) = primals, tangents
    sine, versine = sine_and_versine(x)
    return (sine, versine), ((1 - versine) * along, sine * along)


def _polynomial(coefficients: Sequence[float], x: Array) -> Array:
    """Evaluate a polynomial, highest power first, by Horner's scheme."""
    return reduce(lambda sum_, coefficient: sum_ * x + coefficient, coefficients[1:], jnp.full_like(x, coefficients[0]))
