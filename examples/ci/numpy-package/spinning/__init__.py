"""Integrators of spinning tops."""
