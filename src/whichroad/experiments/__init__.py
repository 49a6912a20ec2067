"""The paper's experiments (Figures 8 to 11, and GST) over many drives of known truth."""

from .all_experiments import NUMBERS, REPORT, SEEDS, TABLE, run_experiments
from .scenes import SCENES

__all__ = ["NUMBERS", "REPORT", "SCENES", "SEEDS", "TABLE", "run_experiments"]
