"""What is driven: classes of scenes, and noises."""

from dataclasses import dataclass, replace

from whichroad.simulate import GOOD, URBAN, SimulationSettings
from whichroad.simulate.scenes import SCENES

VARIANTS = 24  # geometries of each scene


@dataclass(frozen=True, slots=True)
class Class:
    """One class of drives."""

    name: str
    scene: str
    odometry: bool = True


def _all() -> dict[str, Class]:
    classes = [Class(name, name) for name in SCENES]
    classes += [Class(f"{s}-gnss", s, False) for s in SCENES if s.startswith("parallel")]
    return {c.name: c for c in classes}


CLASSES = _all()

MISSPECIFIED = replace(
    GOOD,
    gnss_bias_low=1.5 * GOOD.gnss_bias_low,
    gnss_bias_high=1.5 * GOOD.gnss_bias_high,
    gnss_white=1.5 * GOOD.gnss_white,
    gnss_time=3.0 * GOOD.gnss_time,
)
"""What the receiver reports is too small by half, and lasts three times as long."""

NOISES: dict[str, SimulationSettings] = {
    "good": GOOD,
    "urban": URBAN,
    "misspecified": MISSPECIFIED,
}
