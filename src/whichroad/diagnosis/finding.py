"""What a diagnosis says."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """A sensor, a setting, a map or a drive that does not fit (docs/reference/findings.md)."""

    what: str  # `gnss sigma`, `gnss_time`, `map_sigma`, `wheels: scale`, ...
    level: str  # "warning": answers may be wrong; "information": too careful, or a mere note
    statistic: float
    low: float  # where settings that fit are expected
    high: float
    advice: str

    def __str__(self) -> str:
        """One line for people."""
        return (
            f"{self.what}: {self.statistic:.3g}, {self.low:.3g} to {self.high:.3g} was expected; "
            f"{self.advice}"
        )

    @property
    def note(self) -> str:
        """What it is and what to do, without numbers."""
        return f"{self.what}: {self.advice}"
