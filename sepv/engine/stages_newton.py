"""The text of Newton's iteration for the stages of one lane: `sepv.schemes.collocation`, with every test of it."""

from __future__ import annotations

NEWTON = '''
@_kernel
def _state(y, z, weights, u):
    for i in range(D):
        u[i] = y[i]
        for j in range(STAGES):
            u[i] += weights[j] * z[j * D + i]


@_kernel
def _averages(I, P, y, z, rule, g):
    """g by a rule; the largest component of a gradient."""
    u, t = np.empty(D), np.empty(D)
    g[:] = 0.0
    largest = 0.0
    for n in range(FIRSTS[rule], FIRSTS[rule] + COUNTS[rule]):
        _state(y, z, INTEGRALS[n], u)
        _gradient(u, t, P)
        for r in range(D):
            largest = max(largest, abs(t[r]))
            for i in range(STAGES):
                g[i, r] += W[i, n] * t[r]
    I[EVALUATIONS] += COUNTS[rule]
    return largest


@_kernel
def _all_inside(y, z, rule, P):
    u = np.empty(D)
    _state(y, z, WEIGHTS, u)
    good = _inside(u, P)
    for i in range(STAGES):
        _state(y, z, A[i], u)
        good = good and _inside(u, P)
    for n in range(FIRSTS[rule], FIRSTS[rule] + COUNTS[rule]):
        _state(y, z, INTEGRALS[n], u)
        good = good and _inside(u, P)
    return good


@_kernel
def _agrees(I, P, y, z, rule):
    """Whether a finer rule gives the same averages, to the rounding of its own sums and of its points."""
    used, finer = np.empty((STAGES, D)), np.empty((STAGES, D))
    _averages(I, P, y, z, 2 * rule, used)
    size = _averages(I, P, y, z, 2 * rule + 1, finer)
    widest = 0.0
    for i in range(STAGES):
        total = 0.0
        for n in range(FIRSTS[2 * rule + 1], FIRSTS[2 * rule + 1] + COUNTS[2 * rule + 1]):
            total += abs(W[i, n])
        widest = max(widest, total)
    u, a, b = np.empty(D), np.empty(D), np.empty(D)
    turn = 0.0
    for end in range(2):
        for i in range(D):
            u[i] = y[i]
            for j in range(STAGES if end == 1 else 0):
                u[i] += WEIGHTS[j] * z[j * D + i]
        _gradient(u, a, P)
        for i in range(D):
            u[i] *= 1.0 + 2.0**-26
        _gradient(u, b, P)
        for i in range(D):
            turn = max(turn, abs(b[i] - a[i]) * 2.0**26)
    difference = np.max(np.abs(finer - used))
    return difference <= 2.0**-52 * (COUNTS[2 * rule + 1] * size * widest + 4.0 * turn)


@_kernel
def _newton(I, P, y, z, delta, ladder):
    n = STAGES * D
    rule = 2 * ladder
    g, F, K, moved = np.empty((STAGES, D)), np.empty(n), np.empty((n, n)), np.empty(n)
    u, B, T, C = np.empty(D), np.empty((D, D)), np.empty((D, D)), np.empty((D, D))
    bent = np.empty((STAGES, STAGES, D, D))
    before, limit = INF, FIRST
    for iteration in range(MOST):
        I[WORK] += 1
        _averages(I, P, y, z, rule, g)
        bent[:] = 0.0
        for q in range(FIRSTS[rule], FIRSTS[rule] + COUNTS[rule]):
            _state(y, z, INTEGRALS[q], u)
            _hessian(u, C, P)
            for i in range(STAGES):
                for j in range(STAGES):
                    bent[i, j] += (W[i, q] * INTEGRALS[q, j]) * C
        residual, total, scale = 0.0, 0.0, 0.0
        for i in range(STAGES):
            _state(y, z, A[i], u)
            _structure(u, B, P)
            _turned(u, g[i], T, P)
            for r in range(D):
                field = 0.0
                for l in range(D):
                    field += B[r, l] * g[i, l]
                F[i * D + r] = z[i * D + r] - delta * field
                residual = max(residual, abs(F[i * D + r]))
                total += abs(F[i * D + r])
                scale = max(scale, abs(y[r]) + abs(z[i * D + r]))
                for j in range(STAGES):
                    for c in range(D):
                        value = A[i, j] * T[r, c]
                        for l in range(D):
                            value += B[r, l] * bent[i, j, l, c]
                        K[i * D + r, j * D + c] = (1.0 if i == j and r == c else 0.0) - delta * value
        if not (total < INF):
            return BROKEN
        if residual == 0.0:  # a state at rest is a solution, also where the Jacobian is singular
            return 0
        c = pivoted(K, F)
        m, total = 0.0, 0.0
        for i in range(n):
            m = max(m, abs(c[i]))
            total += abs(c[i])
        if not (total < INF):
            return SINGULAR
        done = m <= limit * scale and m * m <= LEFT * scale * before or m <= TINY * scale
        small = m <= STAGNATION * scale and residual <= ROUNDING * scale
        done = done or small and m >= 0.5 * before
        before, limit, factor, found = m, STAGNATION, 1.0, False
        for halving in range(HALVINGS):
            for i in range(n):
                moved[i] = z[i] - factor * c[i]
            if _all_inside(y, moved, rule, P):
                found = True
                break
            done = False
            factor *= 0.5
        if not found:
            return LEFT_DOMAIN
        z[:] = moved
        if done:
            return 0
    return NO_CONVERGENCE

'''
