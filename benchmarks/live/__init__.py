"""The live service as a process: how late, how much, for how many, and what it survives.

    python -m benchmarks live [--classes latency,matching,bodies,restarts,...]
                              [--seconds S] [--drives N]

The parts are latency, throughput, clients, kill, rubbish, matching, bodies and restarts.
`--seconds` is how long latency, clients, rubbish and each interval of matching last, and
`--drives` how many times the service is killed; throughput plays `--metres` M of a drive over and
over, so many seconds.
"""

from .. import Figure, Options
from .bodies import bodies
from .clients import clients
from .kill import kill
from .latency import latency
from .matching import matching
from .restarts import restarts
from .rubbish import rubbish
from .throughput import throughput

PARTS = {
    "latency": latency,
    "throughput": throughput,
    "clients": clients,
    "kill": kill,
    "rubbish": rubbish,
    "matching": matching,
    "bodies": bodies,
    "restarts": restarts,
}


def run(options: Options) -> list[Figure]:
    """All parts, or those named."""
    wanted = str(options.more.get("classes", ",".join(PARTS))).split(",")
    figures: list[Figure] = []
    for name in wanted:
        options.say(f"{name} ...")
        figures += PARTS[name](options)
    return figures
