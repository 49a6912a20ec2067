"""What an answer is worth against a known truth: errors, honesty, right roads, routes.

Tables come in, figures go out.  Epochs of one drive are correlated: bands for
independent epochs promise too much for one drive.
"""

from .compare import Comparison, compare, pool
from .route_mismatch import Mismatch, route_mismatch
from .score import (
    Evaluation,
    anees_band,
    calibration_error,
    evaluate,
    evaluate_files,
    further_columns,
    score,
    score_files,
)

__all__ = [
    "Comparison",
    "Evaluation",
    "Mismatch",
    "anees_band",
    "calibration_error",
    "compare",
    "evaluate",
    "evaluate_files",
    "further_columns",
    "pool",
    "route_mismatch",
    "score",
    "score_files",
]
