"""The whole pipeline as one scalar loop compiled by numba, as the reference for the speed of the package."""

import numba
import numpy as np

LOG_2PI = np.log(2 * np.pi)


@numba.njit(error_model="numpy", fastmath=True)
def filter_log(dt, q, dq, wrench, arm, joint, bias, gravity, theta, means):
    """Log-likelihood of a log without gaps; fills the filtered (bias, drift) means (T, 2, 6).

    Args:
        dt: (T,) s, sample intervals.
        q: (T, n) rad, joint positions.
        dq: (T, n) rad/s, joint velocities.
        wrench: (T, 6) N, Nm, measured wrench.
        arm: v, s, [s], [s]^2, [s] v, [s]^2 v, position, rotation.
        joint: process density, position and velocity noise, prior, all standard deviations.
        bias: density, wrench variance, prior mean (2, 6), prior std (2, 6).
        gravity: (3,) m/s^2, base frame.
        theta: (10,) inertial parameters of the tool.
        means: (T, 2, 6) array that receives the filtered means.
    """
    n = q.shape[1]
    v0, s0, skew, skew2, skew_v, skew2_v, zero_p, zero_R = arm
    x = np.zeros((n, 3))
    P = np.zeros((n, 3, 3))
    for j in range(n):
        x[j, 0] = q[0, j]
        for a in range(3):
            P[j, a, a] = joint[3][a] ** 2
    b = bias[2].copy()
    B = np.zeros((6, 3))
    for i in range(6):
        B[i, 0], B[i, 2] = bias[3][0, i] ** 2, bias[3][1, i] ** 2
    E, R, S = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    V, W = np.zeros((n, 3)), np.zeros((n, 3))
    e, p, v, w, va, wa = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    K, f, om, al, g = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    t, moved, h, reading, variance = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(6), np.zeros(6)
    by_q, by_a = np.zeros(6), np.zeros(6)
    m, c0, c1, c2 = theta[0], theta[1], theta[2], theta[3]
    xx, xy, xz, yy, yz, zz = theta[4], theta[5], theta[6], theta[7], theta[8], theta[9]
    total = 0.0
    for i in range(len(dt)):
        d = dt[i]
        d2 = d * d
        q00, q01, q02, q11, q12 = d2 * d2 * d / 20, d2 * d2 / 8, d2 * d / 6, d2 * d / 3, d2 / 2
        density, squares = 1.0, 0.0
        for j in range(n):
            qq = joint[0][j] ** 2
            X, Y = x[j], P[j]
            X[0] += d * X[1] + d * d / 2 * X[2]
            X[1] += d * X[2]
            a00 = Y[0, 0] + d * Y[0, 1] + d * d / 2 * Y[0, 2]
            a01 = Y[0, 1] + d * Y[1, 1] + d * d / 2 * Y[1, 2]
            a02 = Y[0, 2] + d * Y[1, 2] + d * d / 2 * Y[2, 2]
            a11, a12 = Y[1, 1] + d * Y[1, 2], Y[1, 2] + d * Y[2, 2]
            p22 = Y[2, 2]
            P00 = a00 + d * a01 + d * d / 2 * a02 + q00 * qq
            P01 = a01 + d * a02 + q01 * qq
            P02 = a02 + q02 * qq
            P11 = a11 + d * a12 + q11 * qq
            P12 = a12 + q12 * qq
            P22 = p22 + d * qq
            r = joint[1][j] ** 2
            w_ = 1 / (P00 + r)
            z = q[i, j] - X[0]
            k0, k1, k2 = P00 * w_, P01 * w_, P02 * w_
            X[0] += k0 * z
            X[1] += k1 * z
            X[2] += k2 * z
            squares += z * z * w_
            density *= w_
            P11 -= k1 * P01
            P12 -= k1 * P02
            P22 -= k2 * P02
            P00, P01, P02 = P00 * r * w_, P01 * r * w_, P02 * r * w_
            r = joint[2][j] ** 2
            w_ = 1 / (P11 + r)
            z = dq[i, j] - X[1]
            k0, k1, k2 = P01 * w_, P11 * w_, P12 * w_
            X[0] += k0 * z
            X[1] += k1 * z
            X[2] += k2 * z
            squares += z * z * w_
            density *= w_
            P00 -= k0 * P01
            P02 -= k0 * P12
            P22 -= k2 * P12
            P01, P11, P12 = P01 * r * w_, P11 * r * w_, P12 * r * w_
            Y[0, 0], Y[0, 1], Y[0, 2], Y[1, 1], Y[1, 2], Y[2, 2] = P00, P01, P02, P11, P12, P22
        R[:] = 0.0
        for a in range(3):
            R[a, a] = 1.0
            p[a] = v[a] = w[a] = va[a] = wa[a] = 0.0
        for j in range(n):
            sin, versine = np.sin(x[j, 0]), 2 * np.sin(x[j, 0] / 2) ** 2
            rest = x[j, 0] - sin
            for a in range(3):
                for k in range(3):
                    E[a, k] = sin * skew[j, a, k] + versine * skew2[j, a, k]
                E[a, a] += 1.0
                e[a] = x[j, 0] * v0[j, a] + versine * skew_v[j, a] + rest * skew2_v[j, a]
            for a in range(3):
                W[j, a] = R[a, 0] * s0[j, 0] + R[a, 1] * s0[j, 1] + R[a, 2] * s0[j, 2]
                V[j, a] = R[a, 0] * v0[j, 0] + R[a, 1] * v0[j, 1] + R[a, 2] * v0[j, 2]
            V[j, 0] += p[1] * W[j, 2] - p[2] * W[j, 1]
            V[j, 1] += p[2] * W[j, 0] - p[0] * W[j, 2]
            V[j, 2] += p[0] * W[j, 1] - p[1] * W[j, 0]
            y, y2 = x[j, 1], x[j, 2]
            for a in range(3):
                a1, a2 = (a + 1) % 3, (a + 2) % 3
                va[a] += V[j, a] * y2 + y * (w[a1] * V[j, a2] - w[a2] * V[j, a1] + v[a1] * W[j, a2] - v[a2] * W[j, a1])
                wa[a] += W[j, a] * y2 + y * (w[a1] * W[j, a2] - w[a2] * W[j, a1])
            for a in range(3):
                v[a] += y * V[j, a]
                w[a] += y * W[j, a]
                p[a] += R[a, 0] * e[0] + R[a, 1] * e[1] + R[a, 2] * e[2]
            for a in range(3):
                for k in range(3):
                    S[a, k] = R[a, 0] * E[0, k] + R[a, 1] * E[1, k] + R[a, 2] * E[2, k]
            R[:] = S
        for a in range(3):
            p[a] += R[a, 0] * zero_p[0] + R[a, 1] * zero_p[1] + R[a, 2] * zero_p[2]
            for k in range(3):
                S[a, k] = R[a, 0] * zero_R[0, k] + R[a, 1] * zero_R[1, k] + R[a, 2] * zero_R[2, k]
        R[:] = S
        for a in range(3):
            a1, a2 = (a + 1) % 3, (a + 2) % 3
            e[a] = v[a] + w[a1] * p[a2] - w[a2] * p[a1]
        for a in range(3):
            a1, a2 = (a + 1) % 3, (a + 2) % 3
            K[a] = va[a] + wa[a1] * p[a2] - wa[a2] * p[a1] + w[a1] * e[a2] - w[a2] * e[a1] - gravity[a]
        for a in range(3):
            f[a] = R[0, a] * K[0] + R[1, a] * K[1] + R[2, a] * K[2]
            om[a] = R[0, a] * w[0] + R[1, a] * w[1] + R[2, a] * w[2]
            al[a] = R[0, a] * wa[0] + R[1, a] * wa[1] + R[2, a] * wa[2]
            g[a] = R[0, a] * gravity[0] + R[1, a] * gravity[1] + R[2, a] * gravity[2]
        e[0], e[1], e[2] = om[1] * c2 - om[2] * c1, om[2] * c0 - om[0] * c2, om[0] * c1 - om[1] * c0
        reading[0] = m * f[0] + al[1] * c2 - al[2] * c1 + om[1] * e[2] - om[2] * e[1]
        reading[1] = m * f[1] + al[2] * c0 - al[0] * c2 + om[2] * e[0] - om[0] * e[2]
        reading[2] = m * f[2] + al[0] * c1 - al[1] * c0 + om[0] * e[1] - om[1] * e[0]
        e[0] = xx * om[0] + xy * om[1] + xz * om[2]
        e[1] = xy * om[0] + yy * om[1] + yz * om[2]
        e[2] = xz * om[0] + yz * om[1] + zz * om[2]
        reading[3] = c1 * f[2] - c2 * f[1] + xx * al[0] + xy * al[1] + xz * al[2] + om[1] * e[2] - om[2] * e[1]
        reading[4] = c2 * f[0] - c0 * f[2] + xy * al[0] + yy * al[1] + yz * al[2] + om[2] * e[0] - om[0] * e[2]
        reading[5] = c0 * f[1] - c1 * f[0] + xz * al[0] + yz * al[1] + zz * al[2] + om[0] * e[1] - om[1] * e[0]
        variance[:] = bias[1]
        for j in range(n):
            for a in range(3):
                a1, a2 = (a + 1) % 3, (a + 2) % 3
                K[a] = V[j, a] + W[j, a1] * p[a2] - W[j, a2] * p[a1]
            for a in range(3):
                t[a] = R[0, a] * W[j, 0] + R[1, a] * W[j, 1] + R[2, a] * W[j, 2]
                moved[a] = R[0, a] * K[0] + R[1, a] * K[1] + R[2, a] * K[2]
            for a in range(3):
                a1, a2 = (a + 1) % 3, (a + 2) % 3
                h[a] = t[a1] * g[a2] - t[a2] * g[a1]
                by_a[a] = m * moved[a] + t[a1] * theta[1 + a2] - t[a2] * theta[1 + a1]
                by_a[3 + a] = theta[1 + a1] * moved[a2] - theta[1 + a2] * moved[a1]
            by_a[3] += xx * t[0] + xy * t[1] + xz * t[2]
            by_a[4] += xy * t[0] + yy * t[1] + yz * t[2]
            by_a[5] += xz * t[0] + yz * t[1] + zz * t[2]
            for a in range(3):
                a1, a2 = (a + 1) % 3, (a + 2) % 3
                by_q[a] = m * h[a]
                by_q[3 + a] = theta[1 + a1] * h[a2] - theta[1 + a2] * h[a1]
            Y = P[j]
            for a in range(6):
                u, y = by_q[a], by_a[a]
                variance[a] += u * (u * Y[0, 0] + 2 * y * Y[0, 2]) + y * y * Y[2, 2]
        for a in range(6):
            qq = bias[0][a] ** 2
            b[0, a] += d * b[1, a]
            B00 = B[a, 0] + 2 * d * B[a, 1] + d * d * B[a, 2] + q11 * qq
            B01 = B[a, 1] + d * B[a, 2] + q12 * qq
            B11 = B[a, 2] + d * qq
            r = variance[a]
            w_ = 1 / (B00 + r)
            z = reading[a] - wrench[i, a] - b[0, a]
            squares += z * z * w_
            density *= w_
            b[0, a] += B00 * w_ * z
            b[1, a] += B01 * w_ * z
            B[a, 0], B[a, 1], B[a, 2] = B00 * r * w_, B01 * r * w_, B11 - B01 * B01 * w_
        means[i] = b
        total += 0.5 * (np.log(density) - squares)
    return total - len(dt) * (2 * n + 6) / 2 * LOG_2PI


def arguments(params):
    """Convert the parameters of the pipeline into the arguments of ``filter_log``."""
    numpy = [np.asarray(x, np.float64) for x in params.arm]
    joint = tuple(np.asarray(x, np.float64) for x in params.joint)
    bias = params.bias
    two = [np.asarray(x, np.float64).reshape(2, 6) for x in (bias.prior_mean, bias.prior_std)]
    rest = (np.asarray(bias.density, np.float64), np.asarray(bias.wrench_variance, np.float64), *two)
    return tuple(numpy), joint, rest, np.asarray(params.gravity, np.float64), np.asarray(params.theta, np.float64)
