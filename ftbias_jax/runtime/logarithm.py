"""The logarithm in vector instructions: XLA calls the scalar function of the C library for every double instead.

x = 2^k m with m within a factor sqrt(2) of 1, and log m = 2 atanh(s) for s = (m - 1) / (m + 1), by the polynomial of
fdlibm: right to the last bit or the one before. Exponent and fraction are read from the bits of the number.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

LOG_2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
"""In two parts: k times the first is exact."""
ODD = (1.531383769920937332e-01, 2.222219843214978396e-01, 3.999999999940941908e-01)
EVEN = (1.479819860511658591e-01, 1.818357216161805012e-01, 2.857142874366239149e-01, 6.666666666666735130e-01)
"""(2 atanh s - 2 s) / s in s^2, every second power, the highest first."""
FRACTION = np.uint64((1 << 52) - 1)
BELOW_ONE = np.uint64(0x3FE6A09E667F3BCD)
"""Bits of sqrt(1/2), the least fraction."""
SHIFT = np.uint64(0x3FF0000000000000) - BELOW_ONE
WHOLE = np.uint64(0x4330000000000000)
"""Bits of 2^52, to which an integer in the last bits adds itself."""


def log(x: Array) -> Array:
    """Natural logarithm of positive normal numbers, any shape; inf and NaN stay what they are."""
    return _log(x) if x.dtype == jnp.float64 else jnp.log(x)


@jax.custom_jvp
def _log(x: Array) -> Array:
    bits = jax.lax.bitcast_convert_type(x, jnp.uint64) + SHIFT
    m = jax.lax.bitcast_convert_type((bits & FRACTION) + BELOW_ONE, jnp.float64)
    k = jax.lax.bitcast_convert_type((bits >> np.uint64(52)) | WHOLE, jnp.float64) - (2.0**52 + 1023)
    f = m - 1
    s = f / (2 + f)
    z = s * s
    w = z * z
    odd = w * (ODD[2] + w * (ODD[1] + w * ODD[0]))
    even = z * (EVEN[3] + w * (EVEN[2] + w * (EVEN[1] + w * EVEN[0])))
    half = f * f / 2
    found = k * LOG_2[0] - ((half - (s * (half + odd + even) + k * LOG_2[1])) - f)
    return jnp.where(x < jnp.inf, found, x)


@_log.defjvp
def _slope(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    (x,), (along,) = primals, tangents
    return _log(x), along / x
