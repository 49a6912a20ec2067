"""Routes: points and path, sure edges between fixes, turning round, wrong fixes, roads beside.

    python -m benchmarks routes
        [--parts agreement,between,turning,oracle,wrong,odometer,collector,parked,rate]
        [--tracks even|odd] [--seeds 20:30] [--intervals 1,5,10,30,60]

Choose on even tracks and Heidelberg seeds 20 to 29; report odd tracks and seeds 30 to 39.
"""

from .. import Figure, Options
from . import agreement, beside, between, odometer, rate, turn_oracle, turning, wrong_fix

PARTS = {
    "agreement": agreement.measure,
    "between": between.measure,
    "turning": turning.measure,
    "oracle": turn_oracle.measure,
    "wrong": wrong_fix.measure,
    "odometer": odometer.measure,
    "collector": beside.collector,
    "parked": beside.parked,
    "rate": rate.measure,
}


def run(options: Options) -> list[Figure]:
    """Measure the parts asked for."""
    found: list[Figure] = []
    for part in options.more.get("parts", ",".join(PARTS)).split(","):
        found += PARTS[part](options)
    return found
