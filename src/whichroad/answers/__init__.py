"""Matched traces as OSRM and Valhalla answer: their keys and types, from this package's filter.

What those services have no word for stands under the key `whichroad` of each answer.
"""

from .refusal import AnswerError
from .requests import osrm_match, trace_attributes, trace_route

__all__ = ["AnswerError", "osrm_match", "trace_attributes", "trace_route"]
