"""Jobs of Spark on two local workers, and what they cost: processor seconds of all processes.

    python -m benchmarks.spark_jobs MAP JOBS

JOBS are JSON: a list of [source, folder to write, options of `whichroad.spark.match`].  A line of
JSON for each says what it cost, without the start of Spark.
"""

import json
import os
import sys
from pathlib import Path
from typing import Any

import whichroad

_TICK = os.sysconf("SC_CLK_TCK")


def descendants(pid: int) -> list[int]:
    """The processes below one, whatever thread started them."""
    found: list[int] = []
    try:
        for task in Path(f"/proc/{pid}/task").iterdir():
            for child in map(int, (task / "children").read_text().split()):
                found += [child, *descendants(child)]
    except OSError:
        pass
    return found


def spent() -> float:
    """Processor seconds of this process and all below it, those that have ended included."""
    total = 0
    for pid in [os.getpid(), *descendants(os.getpid())]:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        total += sum(map(int, fields[11:15]))
    return total / _TICK


def session() -> Any:
    """Two workers of one core each, every one with a process of its own."""
    from pyspark.sql import SparkSession

    os.environ["PYSPARK_PYTHON"] = os.environ["PYSPARK_DRIVER_PYTHON"] = sys.executable
    source = str(Path(whichroad.__file__).parents[1])
    return (
        SparkSession.builder.master("local-cluster[2,1,2048]")
        .config("spark.ui.enabled", "false")
        .config("spark.executor.memory", "1400m")
        .config("spark.sql.shuffle.partitions", "8")
        .config("spark.sql.session.timeZone", "UTC")
        .config("spark.executorEnv.PYTHONPATH", source)
        .config("spark.driver.host", "127.0.0.1")
        .config("spark.driver.bindAddress", "127.0.0.1")
        .getOrCreate()
    )


def main() -> None:
    """Run the jobs one after the other."""
    from whichroad.spark import match

    roads, jobs = sys.argv[1], json.loads(sys.argv[2])
    spark = session()
    spark.sparkContext.setLogLevel("ERROR")
    for source, out, options in jobs:
        before = spent()
        rows = spark.read.parquet(source)
        match(rows, roads, **options).write.mode("overwrite").parquet(out)
        print(json.dumps(spent() - before), flush=True)
    spark.stop()


if __name__ == "__main__":
    main()
