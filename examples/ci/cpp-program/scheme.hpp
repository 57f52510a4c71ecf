// The scheme that the project is about: the implicit midpoint rule for a free rigid body driven by noise.
#pragma once
#include <array>
#include <cmath>
#include <optional>

using State = std::array<double, 3>;

// f = y x grad H for H = sum y_i^2 / (2 I_i).
inline State field(const State &y, const State &inertia) {
    State g{y[0] / inertia[0], y[1] / inertia[1], y[2] / inertia[2]};
    return {y[1] * g[2] - y[2] * g[1], y[2] * g[0] - y[0] * g[2], y[0] * g[1] - y[1] * g[0]};
}

// y1 = y + delta f((y + y1)/2), iterated until it no longer changes; nullopt if the iteration does not converge.
inline std::optional<State> midpoint(const State &y, const State &inertia, double delta) {
    State next = y;
    int still = 0;
    for (int sweep = 0; sweep < 400; ++sweep) {
        State middle;
        for (int i = 0; i < 3; ++i) middle[i] = 0.5 * (y[i] + next[i]);
        const State f = field(middle, inertia);
        double change = 0, size = 0;
        for (int i = 0; i < 3; ++i) {
            const double value = y[i] + delta * f[i];
            change = std::fmax(change, std::fabs(value - next[i]));
            size = std::fmax(size, std::fabs(value));
            next[i] = value;
        }
        if (!std::isfinite(size)) return std::nullopt;
        still = change <= 1e-15 * size ? still + 1 : 0;
        if (still == 4) return next;
    }
    return std::nullopt;
}
