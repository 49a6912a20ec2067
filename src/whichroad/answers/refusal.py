"""What is answered to a request that cannot be answered: status and body of either service."""

from typing import Any

from ..errors import WhichroadError

# numbers and sentences of Valhalla's errors
VALHALLA = {
    100: "Failed to parse json request",
    114: "Insufficiently specified required parameter 'shape' or 'encoded_polyline'",
    123: "Insufficient shape provided",
    124: "No edge/node costing provided",
    125: "No costing method found: '{}'",
    136: "durations size not compatible with trace size",
    153: "Too many shape points: ({}). The best paths shape limit is {}",
    158: "Input trace option is out of bounds:({}). The {} lower limit is 0",
    171: "No suitable edges near location",
    444: "Map Match algorithm failed to find path: map_snap algorithm failed to snap the shape "
    "points to the correct shape.",
    445: "Shape match algorithm specification in api request is incorrect. Please see "
    "documentation for valid shape_match input.",
}


class AnswerError(WhichroadError):
    """A request that is refused, in the words of the service that is spoken.

    Attributes:
        status: The HTTP status.
        answer: The body.
    """

    def __init__(self, status: int, answer: dict[str, Any]) -> None:
        super().__init__(str(answer.get("message") or answer.get("error")))
        self.status, self.answer = status, answer

    @property
    def too_many(self) -> bool:
        """Whether the trace has more points than are taken."""
        return self.answer.get("code") == "TooBig" or self.answer.get("error_code") == 153

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.status, self.answer)


def osrm_error(code: str, message: str) -> AnswerError:
    """OSRM's form.

    Args:
        code: One of its codes, such as InvalidOptions.
        message: A sentence.
    """
    return AnswerError(400, {"code": code, "message": message})


def valhalla_error(code: int, *values: object) -> AnswerError:
    """Valhalla's form.

    Args:
        code: Its number.
        values: What its sentence is filled with.
    """
    body = {"error_code": code, "error": VALHALLA[code].format(*values)}
    return AnswerError(400, {**body, "status_code": 400, "status": "Bad Request"})
