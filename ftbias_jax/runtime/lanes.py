"""Small matrices and vectors as nested lists of entries, each an array over a batch, for the fast routes.

XLA turns each entry into one vectorised loop over the batch; a batch of 3 x 3 arrays would become many short ones.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from operator import add

import jax.numpy as jnp
from jax import Array

Vector = list[Array]
Rows = list[list[Array]]


def dot(a: Vector, b: Vector) -> Array:
    """a^T b."""
    return reduce(add, [x * y for x, y in zip(a, b, strict=True)])


def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def scale(factor: Array, vector: Vector) -> Vector:
    """s v."""
    return [factor * entry for entry in vector]


def total(*vectors: Vector) -> Vector:
    """Sum of vectors."""
    return [reduce(add, entries) for entries in zip(*vectors, strict=True)]


def times(matrix: Rows, vector: Vector) -> Vector:
    """M v."""
    return [dot(row, vector) for row in matrix]


def congruence(A: Rows, P: Rows) -> Rows:
    """A P A^T for a symmetric P."""
    columns = transpose(P)
    AP = [[dot(row, column) for column in columns] for row in A]
    return symmetric(len(P), lambda a, b: dot(AP[a], A[b]))


def transpose(matrix: Rows) -> Rows:
    """M^T."""
    return [list(column) for column in zip(*matrix, strict=True)]


def product(left: Rows, right: Rows) -> Rows:
    """A B."""
    columns = transpose(right)
    return [[dot(row, column) for column in columns] for row in left]


def plus(left: Rows, right: Rows) -> Rows:
    """Sum of two matrices."""
    return [[x + y for x, y in zip(*rows, strict=True)] for rows in zip(left, right, strict=True)]


def add_at(vector: Vector, j: int, value: Array) -> Vector:
    """v + value e_j."""
    return [entry + value if a == j else entry for a, entry in enumerate(vector)]


def add_column(P: Rows, j: int, column: Vector, corner: Array) -> Rows:
    """P + (v e_j^T + e_j v^T) / 2 + s e_j e_j^T."""
    P = [add_at(row, j, column[a] / 2) for a, row in enumerate(P)]
    P[j] = add_at([entry + v / 2 for entry, v in zip(P[j], column, strict=True)], j, corner)
    return P


def symmetric(k: int, entry: Callable[[int, int], Array]) -> Rows:
    """A symmetric matrix from the entries of its upper triangle: symmetric to the last bit, at half the work."""
    upper = {(a, b): entry(a, b) for a in range(k) for b in range(a, k)}
    return [[upper[min(a, b), max(a, b)] for b in range(k)] for a in range(k)]


def upper(P: Rows) -> Vector:
    """The upper triangle, row by row."""
    return [entry for a, row in enumerate(P) for entry in row[a:]]


def from_upper(k: int, entries: Vector) -> Rows:
    """The symmetric k x k matrix with that upper triangle."""
    rest = iter(entries)
    return symmetric(k, lambda a, b: next(rest))


def joseph(P: Rows, gain: Vector, j: int, r: Array, weight: Array) -> Rows:
    """(I - K c) P (I - K c)^T + K r K^T for c = e_j and weight 1 / s; 1 - K_j is r / s, without cancellation."""
    k = len(P)
    rest = jnp.where(weight > 0, r * weight, 1)
    left = [[P[a][b] - gain[a] * P[j][b] if a != j else rest * P[j][b] for b in range(k)] for a in range(k)]

    def entry(a: int, b: int) -> Array:
        kept = left[a][b] - left[a][j] * gain[b] if b != j else left[a][j] * rest
        return kept + gain[a] * r * gain[b]

    return symmetric(k, entry)
