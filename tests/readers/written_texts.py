"""Drives as people and libraries write tables."""

import pandas as pd

from .written import (
    KMH,
    csv,
    degrees,
    installed,
    kind,
    lines,
    text,
)  # fmt: skip


@kind("pandas, by default")
def _(d, p):
    pd.DataFrame({"time": d.iso, "lat": d.lat, "lon": d.lon}).to_csv(p / "a.csv")
    return p / "a.csv"


@kind("pandas, by default, another suffix")
def _(d, p):
    pd.DataFrame({"time": d.iso, "lat": d.lat, "lon": d.lon}).to_csv(p / "a.txt")
    return p / "a.txt"


@kind("pandas, times as an index without a name")
def _(d, p):
    pd.DataFrame({"lat": d.lat, "lon": d.lon}, index=d.at).rename_axis(None).to_csv(p / "a.csv")
    return p / "a.csv"


@kind("comments before the names and between rows")
def _(d, p):
    rows = [f"{t},{lat},{lon}" for t, lat, lon in zip(d.iso, d.lat, d.lon, strict=True)]
    rows.insert(10, "# a pause")
    return text(p / "a.csv", lines(rows, "# logged by me\n# version, 3, of it\ntime,lat,lon\n"))


@kind("names in a comment")
def _(d, p):
    rows = [f"{t},{lat},{lon}" for t, lat, lon in zip(d.iso, d.lat, d.lon, strict=True)]
    return text(p / "a.csv", lines(rows, "# time,lat,lon\n"))


@kind("a preamble")
def _(d, p):
    rows = [f"{t};{lat};{lon}" for t, lat, lon in zip(d.iso, d.lat, d.lon, strict=True)]
    head = "Logger;X200\nSerial;4711\n\nNote;first drive, in rain\n\nTime;Latitude;Longitude\n"
    return text(p / "a.csv", lines(rows, head))


@kind("bars between cells")
def _(d, p):
    return csv(p / "a.txt", {"time": d.iso, **degrees(d)}, sep="|")


@kind("blanks between cells")
def _(d, p):
    rows = [f" {t:.1f}   {a:.7f}  {o:.7f}" for t, a, o in zip(d.time, d.lat, d.lon, strict=True)]
    return text(p / "a.txt", lines(rows, " time   lat  lon\n"))


@kind("packed by gzip")
def _(d, p):
    return csv(p / "a.csv.gz", {"time": d.iso, **degrees(d)})


@kind("packed by zip")
def _(d, p):
    return csv(p / "a.csv.zip", {"time": d.iso, **degrees(d)})


@kind("packed by xz")
def _(d, p):
    return csv(p / "a.csv.xz", {"time": d.iso, **degrees(d)})


@kind("a German spreadsheet", speed=True)
def _(d, p):
    table = {"Zeitpunkt": d.at.dt.strftime("%d.%m.%Y %H:%M:%S"), **degrees(d), "km/h": d.v / KMH}
    return csv(p / "a.csv", table, sep=";", decimal=","), {
        "columns": {"time": "Zeitpunkt", "speed_kmh": "km/h"}
    }


@kind("days of a spreadsheet", abs_time=1e-3)
def _(d, p):
    return csv(p / "a.csv", {"time": d.time / 86_400 + 25_569, **degrees(d)})


@kind("American dates in two columns")
def _(d, p):
    day, clock = d.at.dt.strftime("%m/%d/%Y"), d.at.dt.strftime("%I:%M:%S %p")
    if d.east:  # 06/01/2026 does not show which number is the month
        return csv(p / "a.csv", {"Date": d.at.dt.strftime("%Y-%m-%d"), "Time": clock, **degrees(d)})
    day = pd.Series(day).str.replace("06/01", "06/21")
    d.time = d.time + 20 * 86_400
    return csv(p / "a.csv", {"Date": day, "Time": clock, **degrees(d)})


@kind("dates of mails")
def _(d, p):
    return csv(
        p / "a.csv", {"timestamp": d.at.dt.strftime("%a, %d %b %Y %H:%M:%S GMT"), **degrees(d)}
    )


@kind("compact dates")
def _(d, p):
    return csv(p / "a.csv", {"time": d.at.dt.strftime("%Y%m%d%H%M%S"), **degrees(d)})


@kind("local times and a zone")
def _(d, p):
    zone = "Europe/Berlin" if d.east else "America/Santiago"
    local = d.at.dt.tz_convert(zone).dt.strftime("%Y-%m-%d %H:%M:%S")
    return csv(p / "a.csv", {"time": local, **degrees(d)}), {"tz": zone}


@kind("own names", speed=True)
def _(d, p):
    path = csv(p / "a.csv", {"ts_x": d.iso, "B": d.lat, "L": d.lon, "tempo": d.v / KMH})
    return path, {"columns": {"time": "ts_x", "lat": "B", "lon": "L", "speed_kmh": "tempo"}}


@kind("no names, columns by number")
def _(d, p):
    path = csv(p / "a.csv", {"n": 7, "lat": d.lat, "lon": d.lon, "t": d.iso}, header=False)
    return path, {"columns": {"time": 4, "lat": 2, "lon": "3"}}


@kind("polars, CSV")
def _(d, p):
    installed("polars").DataFrame({"time": list(d.iso), **degrees(d)}).write_csv(p / "a.csv")
    return p / "a.csv"


@kind("polars, Parquet")
def _(d, p):
    pl = installed("polars")
    table = pl.DataFrame({"time": d.at.dt.tz_localize(None).to_numpy(), **degrees(d)})
    table.write_parquet(p / "a.parquet")
    return p / "a.parquet"


@kind("polars, in memory")
def _(d, p):
    return installed("polars").DataFrame({"time": d.time, **degrees(d)})


@kind("DuckDB, in memory")
def _(d, p):
    drive = pd.DataFrame({"time": d.time, **degrees(d)})  # noqa: F841
    return installed("duckdb").sql("select * from drive")


@kind("DuckDB, Parquet")
def _(d, p):
    drive = pd.DataFrame({"ts": d.at, **degrees(d)})  # noqa: F841
    installed("duckdb").sql(f"copy (select * from drive) to '{p / 'a.parquet'}'")
    return p / "a.parquet"
