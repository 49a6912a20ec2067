"""A road that splits at 5 degrees, in an outage: after how many metres is the branch known?"""

from dataclasses import replace
from functools import partial

import numpy as np

from whichroad.roadmap import RoadMap
from whichroad.settings import Settings
from whichroad.simulate import GOOD, MapBuilder, shortest_route, simulate_drive

from .. import Figure, Options
from .drives import SURE, Row, Table, answer, each, named, world

SEEDS = range(10_000, 11_000)
ANGLE_DEG = 5.0
LOOKED_AT = (100.0, 350.0)  # m past the node
SETTINGS = replace(GOOD, stop_probability=0.0, lane_change_rate=0.0)
_BRANCH = 620.0  # m
_LEANS = (0.0, 0.5, 1.0)  # of the angle that the left branch takes


def draw(lean: float, angle_deg: float = ANGLE_DEG) -> RoadMap:
    """The map: 1.4 km with a bend, then two branches.

    Args:
        lean: How much of the angle the left branch turns off; the right one takes the rest.
        angle_deg: Between the branches.
    """
    builder = MapBuilder()
    bend = np.radians(25.0)
    builder.node("begin", -600.0 - 800.0 * np.cos(bend), -800.0 * np.sin(bend))
    builder.node("bend", -600.0, 0.0)
    builder.node("fork", 0.0, 0.0)
    builder.way(["begin", "bend", "fork"], "tertiary", name="Approach", maxspeed="50")
    turns = {"Left": lean * angle_deg, "Right": (lean - 1.0) * angle_deg}
    for name, turn_deg in turns.items():
        turn = np.radians(turn_deg)
        builder.node(name, _BRANCH * np.cos(turn), _BRANCH * np.sin(turn))
        builder.way(["fork", name], "tertiary", name=name, maxspeed="50")
    return builder.compiled()


def prepare(angle_deg: float) -> None:
    """The maps of this process."""
    world["forks"] = [draw(lean, angle_deg) for lean in _LEANS]


def one(seed: int, *, settings: Settings) -> Row:
    """One drive through the fork."""
    random = np.random.default_rng([seed, 77])
    roads: RoadMap = world["forks"][random.integers(len(_LEANS))]
    taken, other = random.permutation(["Left", "Right"]).tolist()
    approach = _leaving(roads, "Approach", towards=True)
    branch = _leaving(roads, taken, towards=False)
    assert shortest_route(
        roads.arrays,
        [int(roads.arrays.edges.from_node[approach]), int(roads.arrays.edges.to_node[branch])],
    ).tolist() == [approach, branch]
    node_m = 0.8 * float(roads.arrays.edges.length[approach])
    dark = node_m - random.uniform(100.0, 400.0)
    drive = simulate_drive(
        roads, seed=seed, scenario=SETTINGS, route=[approach, branch],
        outages_m=((dark, np.inf),),
    )  # fmt: skip
    said = answer(roads, drive, settings)
    past = np.where(drive.truth.edge == branch, drive.truth.along, -1.0)
    right, wrong = said.p_of(named(roads, taken)), said.p_of(named(roads, other))
    seen = (past >= LOOKED_AT[0]) & (past <= LOOKED_AT[1])
    until = (past >= 0.0) & (past <= LOOKED_AT[1])
    best = (right > wrong) & (right > said.rows.p_off_road)
    open_ = np.maximum(right, wrong)[until] <= SURE
    final_right = bool(right[until][-1] > SURE)
    undecided = open_ | ((right[until] > SURE) != final_right)
    last = np.flatnonzero(undecided)
    decided = float(past[until][last[-1]]) if len(last) else 0.0
    return {
        "right": float(best[seen].all()),
        "right_epochs": float(best[seen].sum()),
        "epochs": float(seen.sum()),
        "right_at_end": float(best[until][-1]),
        "decided_m": decided if not open_[-1] else np.inf,
        "decided": float(not open_[-1]),
        "decided_wrong": float(wrong[until][-1] > SURE),
        "ever_sure_wrong": float((wrong[until] > SURE).any()),
        "off": float(said.rows.p_off_road[seen].mean()),
        "lean": float(world["forks"].index(roads)),
    }


def _leaving(roads: RoadMap, name: str, towards: bool) -> int:
    """The edge of a street that leads to, or away from, the fork."""
    at_fork = np.bincount(roads.arrays.edges.to_node) == 3
    node = roads.arrays.edges.to_node if towards else roads.arrays.edges.from_node
    (edge,) = np.flatnonzero(named(roads, name) & at_fork[node])
    return int(edge)


def run(options: Options) -> list[Figure]:
    """All seeds."""
    seeds = options.seeds or SEEDS
    work = partial(one, settings=options.settings())
    rows = each(work, seeds, options, prepare, [ANGLE_DEG])
    table = Table(rows, seeds)
    never = [r["decided_m"] if np.isfinite(r["decided_m"]) else 1e3 for r in rows]
    for row, metres in zip(rows, never, strict=True):
        row["decided_m"] = metres  # undecided at 350 m counts as 1 km
    return [
        table.quantile("P > 0.95 for good after, median", "decided_m", 0.5, "<= 40"),
        table.quantile("the same, 90 %", "decided_m", 0.9),
        table.share("right road at 350 m", "right_at_end", None, ">= 99.5"),
        table.share("right epochs at 100-350 m", "right_epochs", "epochs", ">= 99.5"),
        table.share("right road throughout 100-350 m", "right"),
        table.share("decided at 350 m", "decided"),
        table.share("decided wrongly at 350 m", "decided_wrong"),
        table.share("ever P > 0.95 of the wrong road", "ever_sure_wrong"),
        table.share("P(off-road) there", "off", None, "", "", 1.0),
    ]
