"""References in arbitrary precision. Imports mpmath and the problem description, and no scheme code."""
