"""Does the suite bite? Schemes with one fault each, and which law names it.

Read `_saboteurs` first (the broken schemes, by family), then `_fault_detection` (`sepv teeth`).
"""

from __future__ import annotations

from sepv.faults._fault_detection import Bite as Bite
from sepv.faults._fault_detection import bite as bite
from sepv.faults._saboteurs import Saboteur as Saboteur
