"""Fault detection: schemes broken on purpose (saboteurs), with one fault each, and the laws that find each fault.

`sepv teeth` runs the suite on them, so that they are installed with it. Read `_saboteurs` first (the broken schemes, by
family), then `_fault_detection`. Right schemes that look unusual are in `benchmarks.right_schemes`, which is not
installed.
"""

from __future__ import annotations

from sepv.faults._fault_detection import Detection as Detection
from sepv.faults._fault_detection import detect as detect
from sepv.faults._saboteurs import Saboteur as Saboteur
