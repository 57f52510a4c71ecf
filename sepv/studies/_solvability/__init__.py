"""Solutions of a step's implicit equation that are connected to y0, and those that Newton finds."""
