"""Solutions of a step's implicit equation: those connected to y0 by a branch in Δ, and those found by Newton."""
