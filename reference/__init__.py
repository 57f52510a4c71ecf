"""References in arbitrary precision; they import mpmath and the problem description, and no scheme code."""
