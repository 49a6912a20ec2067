"""The live service as a process: how late, how much, for how many, and what it survives.

    python -m benchmarks live [--classes latency,throughput,clients,kill,rubbish]
                              [--seconds S] [--drives N]

`--seconds` is how long latency, clients and rubbish last, and `--drives` how many times the
service is killed; throughput plays `--metres` M of a drive over and over, so many seconds.
"""

from .. import Figure, Options
from .clients import clients
from .kill import kill
from .latency import latency
from .rubbish import rubbish
from .throughput import throughput

PARTS = {
    "latency": latency,
    "throughput": throughput,
    "clients": clients,
    "kill": kill,
    "rubbish": rubbish,
}


def run(options: Options) -> list[Figure]:
    """All parts, or those named."""
    wanted = str(options.more.get("classes", ",".join(PARTS))).split(",")
    figures: list[Figure] = []
    for name in wanted:
        options.say(f"{name} ...")
        figures += PARTS[name](options)
    return figures
