"""The filter for one epoch at a time, with the least that one call can cost.

The kernel is bound to its tables once, and the few numbers that pass in and out on every call
are packed and unpacked by `struct`: a field of a NumPy record takes several times as long.
"""

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..filter.evidence.evidence_kinds import MOST_AT_ONCE, Evidence, new_evidence
from ..filter.lookback.history import History, new_history
from ..filter.motion import arc_chord
from ..filter.state import (
    EPOCH,
    FILTER,
    HYPOTHESIS,
    PARAMETERS,
    Belief,
    Context,
    D,
    H,
    Path,
    X,
    Y,
    new_belief,
    new_epochs,
    new_path,
)
from ..filter.step import run
from ..filter.summary.estimate import ESTIMATE, new_output
from ..filter.summary.node_shares import ORIGIN
from ..filter.vetting.windows import BY_WHEELS
from ..graph.network import bytes_of
from ..tables.status import far_off

_NO_HISTORY = new_history(0)
_CODES = {"f8": "d", "f4": "f", "i8": "q", "i4": "i", "u1": "B"}
_WORD = 8  # bytes


def _field(dtype: np.dtype[Any], name: str) -> Any:
    """Type and place of a field of a record."""
    assert dtype.fields is not None
    return dtype.fields[name]


def offset_of(dtype: np.dtype[Any], name: str) -> int:
    """Where a field lies in its record, in bytes."""
    return int(_field(dtype, name)[1])


def packed(dtype: np.dtype[Any], *names: str) -> struct.Struct:
    """What unpacks some fields of a record; it packs too where nothing lies between them.

    Args:
        dtype: Of the record.
        names: Of the fields, in the order in which they lie there, from the first of which the
            bytes are counted; those that are arrays become that many numbers.
    """
    text, at = "=", offset_of(dtype, names[0])
    for name in names:
        field, offset = _field(dtype, name)[:2]
        base, shape = field.subdtype or (field, ())
        count = int(np.prod(shape, dtype=int))
        text += f"{offset - at}x{count}{_CODES[base.str[1:]]}"
        at = offset + field.itemsize
    return struct.Struct(text)


def at_word(dtype: np.dtype[Any], name: str) -> int:
    """Where a field of eight bytes lies in its record, in words."""
    offset = offset_of(dtype, name)
    assert offset % _WORD == 0
    return offset // _WORD


class Row(NamedTuple):
    """A record of `filter.summary.estimate.ESTIMATE` as plain numbers, without the other edges."""

    x: float  # m, plane
    y: float
    heading: float  # rad
    xx: float  # covariance, true m, rad
    xy: float
    xh: float
    yy: float
    yh: float
    hh: float
    p_edge: float
    p_way: float
    p_off_road: float
    s: float  # m
    lateral: float
    map_x: float  # m, plane
    map_y: float
    match_x: float
    match_y: float
    speed: float  # m/s
    map_xx: float  # m²
    map_xy: float
    map_yy: float
    protection_level: float  # m
    level_along: float  # m
    level_across: float
    gnss_scale: float
    map_scale: float
    edge: int
    live: int
    status: int


_ROW = packed(
    ESTIMATE, "x", "y", "heading", "cov", "p_edge", "p_way", "p_off_road", "s", "lateral", "map_x",
    "map_y", "match_x", "match_y", "speed", "map_cov", "protection_level", "level_along",
    "level_across", "gnss_scale", "map_scale", "edge", "live", "status",
)  # fmt: skip
_WATCHED_EPOCH = packed(EPOCH, "time", "arc", "turn", "fix", "has_fix")
_WATCHED = packed(ESTIMATE, "x", "y", "heading", "map_x", "map_y", "speed", "gnss_scale")
_MOTION = packed(EPOCH, "time", "arc", "turn", "forward", "left", "unsure")
_FIXED = packed(EPOCH, "fix", "speed", "speed_sigma", "course", "course_sigma")
_FIX_AT = offset_of(EPOCH, "fix")
_ODOMETRY_VALID = offset_of(EPOCH, "odometry_valid")
_HAS_FIX = offset_of(EPOCH, "has_fix")
_GYRO, _GEARED = offset_of(EPOCH, "gyro"), offset_of(EPOCH, "geared")
_EVIDENCE = offset_of(EPOCH, "evidence")
_COUNT, _ROWS, _TIME = (at_word(FILTER, name) for name in ("count", "rows", "time"))
_SPEED, _HEARD = at_word(FILTER, "speed"), at_word(FILTER, "heard")
_STARTED = offset_of(FILTER, "started")
_MODE = at_word(PARAMETERS, "mode")
_WORDS = HYPOTHESIS.itemsize // _WORD  # of a hypothesis


def row_of(estimate: bytes | memoryview) -> Row:
    """A record of `filter.summary.estimate.ESTIMATE` as plain numbers."""
    return Row._make(_ROW.unpack_from(estimate))


class Living(NamedTuple):
    """Columns of the living hypotheses, (n,) each."""

    x: NDArray[np.float64]  # m, plane
    y: NDArray[np.float64]
    heading: NDArray[np.float64]  # rad
    lateral: NDArray[np.float64]  # m
    xx: NDArray[np.float64]  # covariance, true m, rad
    xy: NDArray[np.float64]
    xh: NDArray[np.float64]
    yy: NDArray[np.float64]
    yh: NDArray[np.float64]
    hh: NDArray[np.float64]
    weight: NDArray[np.float64]
    along: NDArray[np.float64]  # m
    edge: NDArray[np.int32]


def _columns() -> NDArray[np.intp]:
    """Where the columns of `Living` lie in a hypothesis, in words."""
    mean, cov = at_word(HYPOTHESIS, "mu"), at_word(HYPOTHESIS, "cov")
    n = int(_field(HYPOTHESIS, "mu")[0].shape[0])
    pairs = ((X, X), (X, Y), (X, H), (Y, Y), (Y, H), (H, H))
    words = [mean + state for state in (X, Y, H, D)] + [cov + n * a + b for a, b in pairs]
    words += [at_word(HYPOTHESIS, name) for name in ("weight", "along", "edge")]
    return np.array(words)


_COLUMNS = _columns()
_WEIGHT = Living._fields.index("weight")
_ORIGIN = at_word(HYPOTHESIS, "scratch") + ORIGIN


def words_of(belief: Belief) -> NDArray[np.int64]:
    """The hypotheses of a belief as words of eight bytes, (C, words), a view."""
    words: NDArray[np.int64] = belief.hyp.view(np.ndarray).view(np.int64)
    return words.reshape(-1, _WORDS)


def living_words(words: NDArray[np.int64], count: int, rows: int) -> NDArray[np.int64]:
    """Copy what `living` needs of the hypotheses; rows behind them are parts of their weight."""
    copied = words[:rows].take(_COLUMNS, axis=1)
    if rows > count:
        weight = copied.view(np.float64)[:, _WEIGHT]
        origin = words[count:rows].view(np.float64)[:, _ORIGIN].astype(np.intp)
        np.subtract.at(weight, origin, weight[count:])
    return copied


def living(copied: NDArray[np.int64]) -> Living:
    """The columns that were copied by `living_words`."""
    numbers = copied.view(np.float64).T
    return Living(*numbers[:-1], copied.view(np.int32)[:, -2])  # type: ignore[call-arg]


class EpochFilter:
    """A belief, one epoch and its estimate, and the kernel bound to them.

    It is for one thread at a time.

    Args:
        ctx: The drive's constants.
        belief: Of no hypotheses, or of what is known; None: a new one.
        path: Tree of edges entered; None: none is kept.
        history: What is stored for smoothing; None: nothing is.
    """

    def __init__(
        self, ctx: Context, belief: Belief | None = None, path: Path | None = None,
        history: History | None = None,
    ) -> None:  # fmt: skip
        self.ctx, self.belief = ctx, belief or new_belief()
        self.path = path or new_path(0)
        self.history = _NO_HISTORY if history is None else history
        self.epochs, self.output = new_epochs(1), new_output(1, False)
        self._view_tables()

    def _view_tables(self) -> None:
        """Views of the tables, and no bound call yet."""
        self.epoch, self.estimate = bytes_of(self.epochs), bytes_of(self.output.rows)
        self.words = words_of(self.belief)
        self._state = bytes_of(self.belief.state)
        self._integers, self._numbers = self._state.cast("q"), self._state.cast("d")
        self._par = bytes_of(self.ctx.par).cast("q")
        self._parts = self._tables()
        self._call: Callable[[], int] | None = None

    def __getstate__(self) -> dict[str, Any]:
        names = ("ctx", "belief", "path", "history", "epochs", "output")
        return {name: getattr(self, name) for name in names}

    def __setstate__(self, tables: dict[str, Any]) -> None:
        self.__dict__.update(tables)
        self._view_tables()

    @property
    def count(self) -> int:
        """How many hypotheses live."""
        return int(self._integers[_COUNT])

    @property
    def _rows(self) -> int:
        """Hypotheses, and their parts across nodes."""
        return max(int(self._integers[_ROWS]), self.count)

    @property
    def time(self) -> float:
        """Of the last epoch, s."""
        return float(self._numbers[_TIME])

    @property
    def speed(self) -> float:
        """m/s, negative in reverse."""
        return float(self._numbers[_SPEED])

    @property
    def started(self) -> bool:
        """Whether there was a fix yet."""
        return self._state[_STARTED] != 0

    @property
    def mode(self) -> int:
        """What moves the vehicle: WHEELS, DISTANCE or CLOCK."""
        return int(self._par[_MODE])

    @property
    def turns_by(self) -> int:
        """What measures the turn of the epoch, as `filter.vetting.windows` counts it."""
        return self.epoch[_GYRO]

    def set_mode(self, mode: int, geared: bool) -> None:
        """Say what moves the vehicle from now on, and whether a gear tells which way."""
        self._par[_MODE] = mode
        self.epoch[_GEARED] = geared

    def heard(self) -> tuple[float, float]:
        """The usual interval of fixes and odometry, and the time of the last one, s."""
        return float(self._numbers[_HEARD + 1]), float(self._numbers[_HEARD])

    def heading(self) -> float:
        """Of the most probable hypothesis, rad."""
        hyp = self.belief.hyp[: self.count]
        return float(hyp["mu"][int(np.argmax(hyp["weight"])), H])

    def widen_along(self, sigma: float) -> None:
        """Make every hypothesis less sure of its place along its heading by a sigma, m."""
        mean, cov = self.belief.hyp["mu"], self.belief.hyp["cov"]
        for i in range(self.count):
            heading = float(mean[i, H])
            east, north = sigma * math.cos(heading), sigma * math.sin(heading)
            cov[i, X, X] += east * east
            cov[i, X, Y] += east * north
            cov[i, Y, X] += east * north
            cov[i, Y, Y] += north * north

    def keep(self, path: Path, history: History) -> None:
        """Go on with other tables of the past: they have grown, or were tidied."""
        if path is not self.path or history is not self.history:
            self.path, self.history, self._call = path, history, None
            self._parts = self._tables()

    def fill(
        self, time: float, arc: float, turn: float, valid: int, by: int = BY_WHEELS,
        unsure: float = 0.0,
    ) -> None:  # fmt: skip
        """Write an epoch without a fix.

        Args:
            time: s.
            arc: Odometer metres since the epoch before.
            turn: rad.
            valid: 1: measured; 2: expected until the next reading; 0: extrapolated.
            by: What measures the turn, as `filter.vetting.windows` counts it.
            unsure: Variance of the arc beyond that of odometry, m².
        """
        epoch = self.epoch
        _MOTION.pack_into(epoch, 0, time, arc, turn, *arc_chord(arc, turn), unsure)
        epoch[_ODOMETRY_VALID] = valid
        epoch[_GYRO] = by
        epoch[_HAS_FIX] = epoch[_EVIDENCE] = 0

    def add_fix(self, fix: Sequence[float]) -> None:
        """Add a fix to the epoch.

        Args:
            fix: The fields of EPOCH from `fix` to `course_sigma`, 9 numbers.
        """
        epoch = self.epoch
        _FIXED.pack_into(epoch, _FIX_AT, *fix)
        epoch[_HAS_FIX] = 1

    def add_evidence(self, evidence: Evidence) -> None:
        """Add what further sensors say to the epoch, at most `MOST_AT_ONCE` rows."""
        work = self.ctx.work
        count = min(len(evidence.rows), MOST_AT_ONCE)
        if len(work.evidence.rows) == 0 or evidence.classes is not work.evidence.classes:
            rows = new_evidence(MOST_AT_ONCE).rows
            self.ctx = self.ctx._replace(work=work._replace(evidence=evidence._replace(rows=rows)))
            self._call = None
        self.ctx.work.evidence.rows[:count] = evidence.rows[:count]
        self.epoch[_EVIDENCE] = count
        self.epochs.first_evidence[0] = 0

    def disbelieved(self, x: float, y: float, sigma: float) -> float:
        """How far away (m) a fix of this epoch (plane m) lies, if it is not believed, else 0."""
        row = row_of(self.estimate)
        away = math.hypot(x - row.x, y - row.y)
        variance = (sigma * max(row.gnss_scale, 1.0)) ** 2 + row.xx + row.yy
        return away if far_off(away, math.sqrt(variance)) else 0.0

    def run(self) -> bool:
        """Take the epoch; False: it was not, as the tables of the past have no room for it."""
        if self._call is None:
            self._call = run.bind(
                self.belief, self.path, self.history, self.epochs, self.output, self.ctx, 0, 1
            )
        return self._call() == 1

    def tables(self) -> dict[str, bytes]:
        """Copies of all tables by name; of the hypotheses those that live."""
        count = self._rows
        parts = self._parts.items()
        return {n: (one[: count * size] if size else one).tobytes() for n, (one, size) in parts}

    def set_tables(self, tables: Mapping[str, bytes]) -> None:
        """Overwrite the tables by copies."""
        for name, (table, _) in self._parts.items():
            table[: len(tables[name])] = tables[name]

    def _tables(self) -> dict[str, tuple[memoryview, int]]:
        """The bytes of each table, and how many of them a hypothesis has; 0: it is of them all."""
        belief, history = self.belief, self.history
        tables = {
            "hypotheses": (bytes_of(belief.hyp), HYPOTHESIS.itemsize),
            "lineage": (bytes_of(belief.lineage), _WORD * belief.lineage.shape[1]),
            "state": (self._state, 0), "epoch": (self.epoch, 0), "estimate": (self.estimate, 0),
        }  # fmt: skip
        if len(history.steps):
            tables["since"] = bytes_of(history.since), 0
            tables["reference"] = bytes_of(history.reference), 0
        return tables

    def living(self) -> NDArray[np.int64]:
        """What `living` needs of the living hypotheses, copied."""
        return living_words(self.words, self.count, self._rows)

    def numbers(self) -> tuple[Sequence[float], Sequence[float]]:
        """Epoch and estimate, as `ConsistencyStatistics.accumulate` takes them."""
        return _WATCHED_EPOCH.unpack_from(self.epoch), _WATCHED.unpack_from(self.estimate)

    def copy_from(self, other: "EpochFilter") -> None:
        """Take over the epoch and the living hypotheses of another filter, not its past."""
        count = other._rows
        self.epoch[:] = other.epoch
        self.estimate[:] = other.estimate
        self._state[:] = other._state
        self.words[:count] = other.words[:count]
        self.belief.state["parents"] = 0
