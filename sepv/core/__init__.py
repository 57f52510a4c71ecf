"""The small core: a step of (2.1) from the functions of a problem to y1. It needs NumPy alone.

To be read from top to bottom, in this order; a file imports only from files above it:

1. `arrays`: batches of states, and products, solutions and differences of them in a fixed order
2. `problem`: what a step uses of a problem, and the random step Δ = h + Σ c_j ΔW_j
3. `average`: the averaged gradient ∫₀¹∇H(y0 + τ(y1 − y0))dτ, exact to rounding
4. `formula`: what the formula of a scheme sees, and Newton's matrix of a formula
5. `newton`: one loop for z = R(z), its stop rule and its statuses
6. `damped`: damped steps for what full steps do not solve
7. `equations`: z = R(z) given by R and ∂R/∂z, with ∂R/∂z from differences where there is no formula
8. `step`: y1 = y0 + R(y0, y1) solved for each path of a batch

What is not the mathematics stands above: who derives, checks and stores a problem's functions
(`sepv.problem`), shapes and messages (`sepv.schemes`), recorded code that is faster
(`sepv.schemes._from_record`), and the compiled engine.
"""
