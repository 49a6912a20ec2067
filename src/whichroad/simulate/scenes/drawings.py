"""The ten kinds of scenes: what is drawn the same, and what differs by geometry."""

from collections.abc import Callable, Sequence

import numpy as np

from ...geodesy.angles import radians
from ...observations import Array
from .scene_builder import SceneBuilder

Random = np.random.Generator
Drawing = Callable[[Random, int], SceneBuilder]

_VERTICES = 18.0  # m between the vertices of drawn curves


def walk(
    start: Array, heading: float, pieces: Sequence[tuple[float, float]], step: float = _VERTICES
) -> tuple[Array, float]:
    """A curve of arcs (length in m, bend in 1/m): points each `step` m, heading at its end."""
    points = [np.asarray(start, float)]
    for length, bend in pieces:
        n = max(1, round(length / step))
        for _ in range(n):
            half = 0.5 * bend * length / n
            chord = length / n * np.sinc(half / np.pi)
            direction = heading + half
            points.append(points[-1] + chord * np.array([np.cos(direction), np.sin(direction)]))
            heading += 2 * half
    return np.array(points), heading


def beside(points: Array, offset: Array) -> Array:
    """A curve moved to its left by `offset` (n,) m."""
    d = np.gradient(points, axis=0)
    d /= np.hypot(d[:, 0], d[:, 1])[:, None]
    moved: Array = points + offset[:, None] * np.column_stack([-d[:, 1], d[:, 0]])
    return moved


def _gentle(random: Random) -> float:
    """The bend of a road that is nearly straight, 1/m."""
    return float(random.normal(0.0, 1.0 / 1500.0))


def junction(random: Random, variant: int) -> SceneBuilder:
    """A Y of 12 to 50 degrees, a Y with a straight on, a T or a cross."""
    builder = SceneBuilder()
    kind = variant % 4
    points, h = walk(np.zeros(2), 0.0, [(random.uniform(220, 320), _gentle(random))])
    node = builder.add("approach", points)
    if kind == 0:
        angle = radians(random.uniform(12.0, 50.0))
        turns = [0.5 * angle, -0.5 * angle]
    elif kind == 1:
        turns = [0.0, radians(random.uniform(15.0, 60.0)) * random.choice([-1, 1])]
    elif kind == 2:
        skew = radians(random.uniform(-20.0, 20.0))
        turns = [np.pi / 2 + skew, -np.pi / 2 + skew]
    else:
        skew = radians(random.uniform(-20.0, 20.0))
        turns = [0.0, np.pi / 2 + skew, -np.pi / 2 + skew]
    for k, turn in enumerate(turns):
        line, _ = walk(node, h + turn, [(random.uniform(220, 300), _gentle(random))])
        builder.add(f"branch {k}", line)
        builder.route(["approach", f"branch {k}"], 1)
    return builder


def parallel(gap: float) -> Drawing:
    """A fork into two one-way roads that run `gap` m apart for 400 m."""

    def draw(random: Random, variant: int) -> SceneBuilder:
        builder = SceneBuilder()
        before = random.uniform(200.0, 280.0)
        points, h = walk(np.zeros(2), 0.0, [(before, _gentle(random))])
        node = builder.add("approach", points, one_way=True)
        base, _ = walk(node, h, [(random.uniform(380, 440), _gentle(random))], 6.0)
        part = random.uniform(30.0 + 2.0 * gap, 60.0 + 4.0 * gap)  # m, over which they part
        s = np.arange(len(base)) * 6.0
        share = 0.5 - 0.5 * np.cos(np.pi * np.minimum(s / part, 1.0))
        left = (0.5, 1.0, 0.0)[variant % 3] * gap  # both bend away, or one goes straight on
        for name, offset in (("left", left), ("right", left - gap)):
            builder.add(name, beside(base, offset * share), one_way=True)
            builder.route(["approach", name], 1)
        return builder

    return draw


def roundabout(random: Random, variant: int) -> SceneBuilder:
    """A ring of 12 to 25 m radius with four or five arms, entered from the first."""
    builder = SceneBuilder()
    radius, arms = random.uniform(12.0, 25.0), 4 + variant % 2
    angle = np.pi + 2 * np.pi * np.arange(arms) / arms + random.uniform(-0.2, 0.2, arms)
    for k in range(arms):
        low, high = angle[k], angle[(k + 1) % arms] + (2 * np.pi if k == arms - 1 else 0.0)
        a = np.linspace(low, high, 5)
        ring = radius * np.column_stack([np.cos(a), np.sin(a)])
        builder.add(f"ring {k}", ring, one_way=True, ring=True, kmh=28.0)
    for k in range(arms):
        out = angle[k] + random.uniform(-0.15, 0.15)
        start = builder.streets[f"ring {k}"].points[0]
        points, _ = walk(start, out, [(random.uniform(200, 260), _gentle(random))])
        builder.add(f"arm {k}", points)
    builder.streets[f"ring {arms - 1}"].points[-1] = builder.streets["ring 0"].points[0]
    for k in range(arms - 1):  # ring k ends where ring k + 1 begins
        builder.streets[f"ring {k}"].points[-1] = builder.streets[f"ring {k + 1}"].points[0]
    for k in range(1, arms):
        rings = [f"ring {j}" for j in range(k)]
        builder.route(["-arm 0", *rings, f"arm {k}"], 1 + k)
    return builder


def grid(random: Random, variant: int) -> SceneBuilder:
    """Narrow streets with blocks of 60 to 100 m; decided at the fourth crossing."""
    builder, size = SceneBuilder(), 5
    block = random.uniform(60.0, 100.0)
    node = np.array([[(c, r) for r in range(size)] for c in range(size)], float) * block
    node += random.uniform(-0.12 * block, 0.12 * block, node.shape)
    links: dict[tuple[int, int], list[tuple[str, tuple[int, int]]]] = {}
    for c in range(size):
        for r in range(size):
            for to in ((c + 1, r), (c, r + 1)):
                if max(to) < size:
                    name = f"{c}{r} {to[0]}{to[1]}"
                    builder.add(name, np.array([node[c, r], node[to]]), highway="residential")
                    links.setdefault((c, r), []).append((name, to))
                    links.setdefault(to, []).append(("-" + name, (c, r)))
    for c in (0, size - 1):  # a stub at each corner, so that no corner is a mere bend
        for r in (0, size - 1):
            out = node[c, r] + 0.7 * block * np.sign([c - 1, r - 1])
            builder.add(f"stub {c}{r}", np.array([node[c, r], out]), highway="residential")
    while len(builder.routes) < 10:
        at = (int(random.integers(size)), int(random.integers(size)))
        names: list[str] = []
        while len(names) < 6:
            back = names[-1].lstrip("-") if names else ""
            choices = [w for w in links[at] if w[0].lstrip("-") != back]
            name, at = choices[random.integers(len(choices))]
            names.append(name)
        builder.route(names, 4, block)
    return builder


def ramp(random: Random, variant: int) -> SceneBuilder:
    """An exit that leaves a motorway at 4 to 8 degrees and runs 12 to 25 m beside it."""
    builder = SceneBuilder()
    points, h = walk(np.zeros(2), 0.0, [(random.uniform(350, 450), _gentle(random) / 2)], 30.0)
    node = builder.add("approach", points, highway="motorway", one_way=True)
    base, _ = walk(node, h, [(random.uniform(550, 650), _gentle(random) / 2)], 10.0)
    gap, slope = random.uniform(12.0, 25.0), np.tan(radians(random.uniform(4.0, 8.0)))
    s = np.arange(len(base)) * 10.0
    rest = np.maximum(gap - slope * s, 0.0)  # straight away, then rounded into the parallel
    share = gap - np.sqrt(rest**2 + 1.0) + np.sqrt(gap**2 + 1.0) - gap
    builder.add("main", base, highway="motorway", one_way=True)
    builder.add(
        "exit", beside(base, -np.maximum(share, 0.0)), highway="motorway_link", one_way=True,
        kmh=70.0,
    )  # fmt: skip
    builder.route(["approach", "main"], 1)
    builder.route(["approach", "exit"], 1)
    return builder


def off_map(random: Random, variant: int) -> SceneBuilder:
    """A street that the map lacks leads from one road to another; decided on coming back."""
    builder = SceneBuilder()
    between, cut = random.uniform(110.0, 220.0), random.uniform(220.0, 300.0)
    skew = random.uniform(-60.0, 60.0)
    far, west, east = cut + skew, -60.0, cut + 320.0
    along, across = np.array([1.0, 0.0]), np.array([0.0, 1.0])

    def straight(a: Array, b: Array) -> Array:
        n = max(2, round(float(np.hypot(*(b - a))) / 40.0) + 1)
        return a + np.linspace(0.0, 1.0, n)[:, None] * (b - a)

    top = between * across
    builder.add("main/1", straight(west * along, cut * along))
    builder.add("main/2", straight(cut * along, east * along))
    builder.add("hidden", straight(cut * along, far * along + top), highway="residential",
               mapped=False)  # fmt: skip
    builder.add("other/1", straight(west * along + top, far * along + top))
    builder.add("other/2", straight(far * along + top, east * along + top))
    builder.add("side west", straight(west * along, west * along + top), highway="residential")
    builder.add("side east", straight(east * along, east * along + top), highway="residential")
    builder.route(["main/1", "hidden", "other/2"], 2)
    builder.route(["main/1", "hidden", "-other/1"], 2)
    return builder


def tunnel(random: Random, variant: int) -> SceneBuilder:
    """500 to 1,500 m without GNSS, with one fork or two in them; the last is decided."""
    builder = SceneBuilder()
    dark, before = random.uniform(500.0, 1500.0), 220.0
    bends = [(float(random.uniform(120, 260)), float(random.normal(0, 1 / 250))) for _ in range(12)]
    at = float(random.uniform(200.0, dark - 200.0))
    first = [(before, _gentle(random))]
    for piece in bends:
        if sum(p[0] for p in first) < before + at:
            first.append(piece)
    points, h = walk(np.zeros(2), 0.0, first)
    node = builder.add("approach", points, kmh=60.0)
    angle = radians(random.uniform(5.0, 30.0))
    length = before + dark - sum(p[0] for p in first) + 250.0
    names = ["approach"]
    if variant % 2:
        for k, side in enumerate((0.5, -0.5)):
            line, _ = walk(node, h + side * angle, [(150.0, _gentle(random))])
            builder.add(f"first {k}", line, kmh=60.0)
        names.append("first 0")
        node, h = line_end(builder.streets["first 0"].points)
        angle = radians(random.uniform(5.0, 30.0))
    for k, side in enumerate((0.5, -0.5)):
        line, _ = walk(
            node, h + side * angle, [(max(length, 300.0), float(random.normal(0, 1 / 600)))]
        )
        builder.add(f"last {k}", line, kmh=60.0)
        builder.route([*names, f"last {k}"], len(names))
    builder.mask = (before, before + dark)
    return builder


def line_end(points: Array) -> tuple[Array, float]:
    """Last point and direction there."""
    d = points[-1] - points[-2]
    return points[-1], float(np.arctan2(d[1], d[0]))


SCENES: dict[str, Drawing] = {
    "junction": junction,
    "parallel-8": parallel(8.0),
    "parallel-12": parallel(12.0),
    "parallel-18": parallel(18.0),
    "parallel-25": parallel(25.0),
    "roundabout": roundabout,
    "grid": grid,
    "ramp": ramp,
    "off-map": off_map,
    "tunnel": tunnel,
}
