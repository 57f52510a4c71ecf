"""Schemes of other libraries, through their own stepping code. Each module needs its library: see the extras."""
