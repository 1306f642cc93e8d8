"""Small matrices and vectors as nested lists of entries, each an array over a batch, for the fast implementations.

XLA turns each entry into one vectorised loop over the batch; a batch of 3 x 3 arrays would become many short loops. An
entry that is 0 or 1 for the whole batch may be that integer: it then costs no operation, whereas XLA would multiply.
"""

from collections.abc import Callable, Sequence
from functools import reduce
from typing import cast

import jax.numpy as jnp
from jax import Array

Vector = list[Array]
Rows = list[list[Array]]
Entry = Array | int
Entries = Sequence[Entry]
Table = Sequence[Entries]
"""Rows that may hold integers."""


def dot(a: Entries, b: Entries) -> Array:
    """a^T b."""
    return cast("Array", reduce(_plus, [_times(x, y) for x, y in zip(a, b, strict=True)]))


def _times(a: Entry, b: Entry) -> Entry:
    for x, y in ((a, b), (b, a)):
        if isinstance(x, int):
            return y if x == 1 else 0 if x == 0 else x * y
    return a * b


def _plus(a: Entry, b: Entry) -> Entry:
    if isinstance(a, int) and a == 0:
        return b
    return a if isinstance(b, int) and b == 0 else a + b


def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def scale(factor: Array, vector: Vector) -> Vector:
    """s v."""
    return [factor * entry for entry in vector]


def total(*vectors: Entries) -> Vector:
    """Sum of vectors."""
    return [cast("Array", reduce(_plus, entries)) for entries in zip(*vectors, strict=True)]


def times(matrix: Table, vector: Entries) -> Vector:
    """M v."""
    return [dot(row, vector) for row in matrix]


def congruence(A: Table, P: Table) -> Rows:
    """A P A^T for a symmetric P."""
    columns = transpose(P)
    AP = [[dot(row, column) for column in columns] for row in A]
    return symmetric(len(P), lambda a, b: dot(AP[a], A[b]))


def transpose(matrix: Table) -> Rows:
    """M^T."""
    return cast("Rows", [list(column) for column in zip(*matrix, strict=True)])


def product(left: Table, right: Table) -> Rows:
    """A B."""
    columns = transpose(right)
    return [[dot(row, column) for column in columns] for row in left]


def plus(left: Table, right: Table) -> Rows:
    """Sum of two matrices."""
    return [total(*rows) for rows in zip(left, right, strict=True)]


def add_at(vector: Vector, j: int, value: Array) -> Vector:
    """v + value e_j."""
    return [entry + value if a == j else entry for a, entry in enumerate(vector)]


def symmetric(k: int, entry: Callable[[int, int], Array]) -> Rows:
    """A symmetric matrix from the entries of its upper triangle: symmetric to the last bit, at half the work."""
    upper = {(a, b): entry(a, b) for a in range(k) for b in range(a, k)}
    return [[upper[min(a, b), max(a, b)] for b in range(k)] for a in range(k)]


def upper(P: Rows) -> Vector:
    """The upper triangle, row by row."""
    return [entry for a, row in enumerate(P) for entry in row[a:]]


def from_upper(k: int, entries: Vector) -> Rows:
    """The symmetric k x k matrix with the given upper triangle, row by row."""
    rest = iter(entries)
    return symmetric(k, lambda a, b: next(rest))


def joseph(P: Rows, gain: Vector, j: int, r: Array, weight: Array) -> Rows:
    """Joseph update (I - K c) P (I - K c)^T + K r K^T for c = e_j and weight 1 / s, symmetric to the last bit.

    With K = P e_j / s, row j is P_j r / s, without cancellation. Elsewhere Joseph's terms (P_aj - K_a P_jj) K_b and
    K_a r K_b are equal and cancel, which leaves P_ab - K_a P_jb.
    """
    rest = jnp.where(weight > 0, r * weight, 1)

    def entry(a: int, b: int) -> Array:
        return rest * P[a][b] if j in (a, b) else P[a][b] - gain[a] * P[j][b]

    return symmetric(len(P), entry)
