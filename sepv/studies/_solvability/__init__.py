"""Where the implicit equation of a step has a solution connected to y0, and where Newton finds it."""
