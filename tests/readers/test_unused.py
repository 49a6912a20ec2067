"""Sensors of a drive that its odometry is not made of are named."""

import pytest

from demands.town import corners, fixes
from whichroad import read_drive

LEFT, RIGHT = "speed of the left rear wheel", "speed of the right rear wheel"
ONE_AT_A_TIME = "one odometry is used at a time, wheels first"


@pytest.mark.parametrize(
    ("columns", "note"),
    [
        (["wheel_rl_mps"], f"{LEFT} not used: both rear wheels were expected"),
        (["wheel_rr_mps"], f"{RIGHT} not used: both rear wheels were expected"),
        (["wheel_rl_ticks"], "counter of the left rear wheel not used: both rear wheels"),
        (["yaw_rate_radps"], "yaw rate not used: a speed beside it was expected"),
        (["odometer_m", "wheel_rl_mps"], f"{LEFT} not used: {ONE_AT_A_TIME}"),
    ],
)
def test_what_is_not_used_is_named_with_its_reason(tmp_path, columns, note):
    assert any(said.startswith(note) for said in written(tmp_path, columns).notes)


@pytest.mark.parametrize(
    "columns",
    [[], ["odometer_m"], ["wheel_rl_mps", "wheel_rr_mps"], ["wheel_rl_ticks", "wheel_rr_ticks"],
     ["speed_mps", "yaw_rate_radps"], ["odometer_m", "yaw_rate_radps"],
     ["wheel_rl_mps", "wheel_rr_mps", "yaw_rate_radps"]],
)  # fmt: skip
def test_nothing_is_said_where_all_is_used(tmp_path, columns):
    assert not any("not used" in said for said in written(tmp_path, columns).notes)


def written(folder, columns):
    """A drive read from a table with these columns of odometry beside its fixes."""
    table = fixes(corners("20", "24"), sigma=2.0)
    lines = [",".join([*table, *columns])]
    for k, row in enumerate(zip(*table.values(), strict=True)):
        values = [10.0 * k if name.endswith(("_m", "ticks")) else 0.5 for name in columns]
        lines.append(",".join(str(v) for v in [*row, *values]))
    file = folder / "drive.csv"
    file.write_text("\n".join(lines), encoding="utf-8")
    (drive,) = read_drive(file)
    return drive
