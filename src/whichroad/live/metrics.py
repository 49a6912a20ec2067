"""Figures of a filter loop in the text format of Prometheus."""

import math

from .broadcaster import Broadcaster
from .filter_loop import FilterLoop
from .health import label, metric


def metrics_of(filter_loop: FilterLoop, broadcaster: Broadcaster) -> list[str]:
    """Lines of the Prometheus text format."""
    message, health = filter_loop.message, filter_loop.health()
    sensors = {f'{{sensor="{label(s["name"])}"}}': s for s in health["sensors"]}
    lines = metric(
        "whichroad_messages_total", "counter", "Messages published.", {"": filter_loop.seq}
    )
    lines += metric(
        "whichroad_observations_total", "counter", "Observations taken, by input.",
        {key: s["count"] for key, s in sensors.items()},
    )  # fmt: skip
    lines += metric(
        "whichroad_skipped_total", "counter", "Records that could not be used, by input.",
        {key: s["skipped"] for key, s in sensors.items()},
    )  # fmt: skip
    lines += metric(
        "whichroad_sensor_up", "gauge", "1: the input delivers.",
        {key: int(s["ok"]) for key, s in sensors.items()},
    )  # fmt: skip
    lines += metric("whichroad_listeners", "gauge", "Listeners.", {"": broadcaster.listeners})
    lines += metric(
        "whichroad_dropped_total", "counter", "Listeners too slow.", {"": broadcaster.dropped}
    )
    late = filter_loop.buffer.skipped["late"]
    lines += metric("whichroad_late_total", "counter", "Observations too late.", {"": late})
    if message is not None:
        lines += metric("whichroad_p_road", "gauge", "P of the road.", {"": message["p_road"]})
        off = message["p_off_road"]
        lines += metric("whichroad_p_off_road", "gauge", "P of being off the roads.", {"": off})
        level = message["protection_m"]
        level = math.inf if level is None else level
        lines += metric("whichroad_protection_meters", "gauge", "Protection level.", {
            "": "+Inf" if level == math.inf else level})  # fmt: skip
    name = "whichroad_latency_seconds"
    lines += [f"# HELP {name} From arrival to publication.", f"# TYPE {name} histogram"]
    return lines + filter_loop.latency.histogram(name)
