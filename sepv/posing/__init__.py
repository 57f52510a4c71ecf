"""B, H, ∇H and f = B∇H of a problem as formulas and numbers, for libraries with their own arrays,
such as JAX or torch.

`pose` does it for a system (1.1), `pose_fields` for several Hamiltonians. No array library is
imported: a formula gets the library itself, such as jax.numpy, as its first argument.
"""

from __future__ import annotations

from sepv.posing._fields import OneField, pose_one_field
from sepv.posing._fields import PosedFields as PosedFields
from sepv.posing._fields import pose_fields as pose_fields
from sepv.posing._formulas import POSED_LANES, Path, size
from sepv.posing._formulas import Formulas as Formulas
from sepv.posing._formulas import field_in as field_in
from sepv.posing._formulas import in_blocks as in_blocks
from sepv.posing._formulas import pose as pose
