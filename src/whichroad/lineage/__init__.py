"""Births, deaths and reasons of a drive's hypotheses: it goes through the filter again."""

from .lives import WHY, Hypothesis, lives_of
from .table import Lineage, lineage_of

__all__ = ["WHY", "Hypothesis", "Lineage", "lineage_of", "lives_of"]
