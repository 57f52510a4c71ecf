"""Fault detection: schemes broken on purpose (saboteurs), with one fault each,
and the laws that find each fault.

The saboteurs are installed with sepv, because `sepv teeth` runs the suite on them. Read `saboteurs`
first (the broken schemes, by family), then `detection`. Right schemes that look unusual are in
`benchmarks.right_schemes`, which is not installed.
"""

from __future__ import annotations

from .detection import Detection as Detection
from .detection import detect as detect
from .saboteurs import Saboteur as Saboteur
