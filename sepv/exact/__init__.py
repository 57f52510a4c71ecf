"""The exact flow at the random time t + Σ c_jW_j(t) (Proposition 2.1).

Read `_flow` first. It uses a closed form if the problem has one (`_closed_forms`), and otherwise a
numerical solution with rounding accuracy (`_dense_flow`). `_truncation_error` computes the error of
clipped increments (Remark 2.1).
"""

from __future__ import annotations

from sepv.exact._closed_forms import CLOSED_FORMS as CLOSED_FORMS
from sepv.exact._closed_orbit import PHASES, Orbit, closed_orbit
from sepv.exact._dense_flow import FlowFailure
from sepv.exact._flow import ExactFlow as ExactFlow
from sepv.exact._flow import exact_flow as exact_flow
from sepv.exact._truncation_error import clipping_error as clipping_error
