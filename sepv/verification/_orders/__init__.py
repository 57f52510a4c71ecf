"""_orders."""
