"""The settings as the kernels take them."""

from typing import NamedTuple


class Parameters(NamedTuple):
    """Floats in SI; `settings.Settings` tells units, bounds and reasons."""

    heading_noise: float
    turn_noise: float
    along_noise: float
    lateral_noise: float
    yaw_bias_noise: float
    acceleration_noise: float
    scale_sigma: float
    drift_sigma: float
    lane_sigma: float
    lane_length: float
    map_sigma: float
    map_length: float
    relative_sigma: float
    edge_heading_sigma: float
    node_radius: float
    node_sigma: float
    node_heading_sigma: float
    map_spacing: float
    gnss_white_ratio: float
    gnss_time: float
    gnss_gate: float
    gnss_adapt_time: float
    gnss_start: float
    gnss_fault_time: float
    gnss_lost: float
    off_road_leave: float
    off_road_return: float
    off_road_cost: float
    off_road_start: float
    wrong_way: float
    u_turn_rate: float
    search_radius: float
    prune: float
    merge: float
    components: float
    lost_after: float
    protection_risk: float
    unknown: float
