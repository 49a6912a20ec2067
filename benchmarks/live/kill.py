"""kill -9 at random moments under load: what is lost, what is readable, what resumes."""

import random
import time

from whichroad import ReadError, read_drive
from whichroad.evaluate.input_tables import read_table
from whichroad.live.checkpoint import read_checkpoint

from .. import Figure, Options
from .process import Feed, Receiver, Served, can_options
from .world import world


def kill(options: Options) -> list[Figure]:
    """So many times; the vehicle drives on meanwhile."""
    times = options.more.get("drives", 10)
    rng = random.Random(1)
    resumed = readable = 0
    lost, behind = [], []
    with world(20_000.0) as here:
        receiver = Receiver()
        sources = ("--nmea", f"tcp://127.0.0.1:{receiver.port}", *can_options(here))
        keep = ("--record", here.folder / "rec", "--state", here.folder / "state")
        feed = Feed(here, receiver.send)
        for number in range(times + 1):
            served = Served(*here.options(), *sources, *keep)
            served.answered()
            time.sleep(rng.uniform(0.7, 2.0))
            health, at = served.get("/health"), time.time()
            said = served.kill()
            ages = [one["age_s"] for one in health["sensors"] if one["age_s"] is not None]
            heard = at - min(ages, default=float("inf"))
            resumed += number > 0 and "resumed" in said
            try:
                behind.append(at - read_checkpoint(here.folder / "state")[0]["written"])
            except (OSError, ReadError):
                behind.append(float("inf"))
            try:
                (drive,) = read_drive(here.folder / "rec", vehicle=here.vehicle)
                readable += read_table(here.folder / "rec").num_rows > 0
                lost.append(heard - max(drive.odometry.time[-1], drive.fixes.time[-1]))
            except Exception as error:
                options.say(f"kill {number}: {error}")
        feed.stop()
        receiver.close()
    return [
        Figure("restarts that resume", float(resumed), f">= {times}", "", times),
        Figure("recordings readable", float(readable), f">= {times + 1}", "", times + 1),
        Figure("recording behind what was heard, worst", max(lost), "<= 1", "s", times + 1),
        Figure("state behind, worst", max(behind), "<= 1", "s", times + 1),
    ]
