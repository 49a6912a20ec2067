"""What does not work now: told to the operator as it begins and ends, to others by `/health`."""

from collections.abc import Callable


class Troubles:
    """Those of one vehicle.  Nothing here ends the service.

    Args:
        report: Takes a line for the operator; it is called from any thread.
        vehicle: Its name, where a service has several.
    """

    def __init__(
        self, report: Callable[[str], None] = lambda line: None, vehicle: str | None = None
    ) -> None:
        self._report, self._now = report, dict[str, str]()
        self._prefix = "" if vehicle is None else f"{vehicle}: "

    def report(self, line: str) -> None:
        """A line for the operator."""
        self._report(self._prefix + line)

    def begin(self, what: str, reason: str, line: str) -> None:
        """Something does not work; it is told where that is new, or has another reason.

        Args:
            what: For everybody, without a path.
            reason: Likewise.
            line: For the operator.
        """
        if self._now.get(what) != reason:
            self._now[what] = reason
            self.report(line)

    def holds(self, what: str) -> bool:
        """Whether it is told as not working."""
        return what in self._now

    def end(self, what: str, line: str) -> None:
        """It works; that is told where it did not."""
        if self._now.pop(what, None) is not None:
            self.report(line)

    def messages(self) -> list[str]:
        """What does not work, as `/health` tells it."""
        return [f"{what}: {reason}" for what, reason in list(self._now.items())]
