"""The numerical experiments of §4, figure by figure, with a verdict on every statement made about them."""

from __future__ import annotations

from sepv.studies._reproduce.job import Size as Size
from sepv.studies._reproduce.suite import FIGURES as FIGURES
from sepv.studies._reproduce.suite import Reproduction as Reproduction
from sepv.studies._reproduce.suite import reproduce as reproduce
