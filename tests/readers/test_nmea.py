"""NMEA: positions, times and covariances as receivers write them, streamed or whole."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pynmeagps import NMEAReader

from whichroad.errors import ReadError
from whichroad.evidence.sensed import columns_of
from whichroad.observations import ASSUMED, FROM_HDOP, FROM_QUALITY, NO_CORRELATION, RECKONED_PLACE
from whichroad.readers import NmeaParser, read_drive
from whichroad.readers.reckoned_places import LEFT_OUT
from whichroad.readers.reported_fixes import as_records, from_gst
from whichroad.sensors import DualAntenna
from whichroad.settings import Settings

KNOT = 1852 / 3600
WITH_FIXES = (
    *("isync", "quectel-L70", "skytraq-dgps"),
    *("ublox-neo-m9n-nmea", "ublox-zed-f9p-nmea", "ublox-zed-f9r"),
)
NOON = 1_780_315_200.0  # 2026-06-01 12:00 UTC


@pytest.fixture
def read(put):
    """A function from a log's bytes to its drive."""
    return lambda content: read_drive(put("log.nmea", content))[0]


def log_of(nmea, n=60, **kwargs):
    """Seconds of a drive about the globe's corners."""
    rng = np.random.default_rng(5)
    lines = []
    for k in range(n):
        lines.append(
            nmea.burst(
                clock=f"12{k // 60:02d}{k % 60:02d}.00",
                lat=float(rng.uniform(-89, 89)),
                lon=float(rng.uniform(-179, 179)),
                knots=round(float(rng.uniform(3, 60)), 2),
                course=f"{rng.uniform(0, 360):.1f}",
                gst="{0:.1f},{1:.1f},{2:.1f},{0:.1f},{1:.1f}".format(
                    *rng.uniform(1, 9, 2), rng.uniform(0, 180)
                ),
                **kwargs,
            )
        )
    return b"".join(lines)


def oracle(content, kind):
    """Sentences of one type, by pynmeagps."""
    return [
        m for _, m in NMEAReader(_stream(content), validate=1, quitonerror=2) if m.msgID == kind
    ]


def _stream(content):
    import io

    return io.BytesIO(content)


def test_positions_speeds_and_courses_are_those_of_pynmeagps(nmea, read, sound):
    content = log_of(nmea)
    drive = read(content)
    sound(drive)
    fixes, rmc, gst = drive.fixes, oracle(content, "RMC"), oracle(content, "GST")
    assert len(fixes) == len(rmc) == 60
    assert not drive.skipped
    assert fixes.time == pytest.approx(NOON + np.arange(60.0), abs=1e-6)
    # both are rounded: a millionth of a minute here, 1e-8 degrees there
    assert np.abs(fixes.lat_deg - [m.lat for m in rmc]).max() < 2e-8
    assert np.abs(fixes.lon_deg - [m.lon for m in rmc]).max() < 2e-8
    assert fixes.speed == pytest.approx([KNOT * m.spd for m in rmc])
    assert fixes.bearing_deg == pytest.approx([m.cog for m in rmc])
    assert np.sqrt(fixes.cov_nn) == pytest.approx([m.stdLat for m in gst])
    assert np.sqrt(fixes.cov_ee) == pytest.approx([m.stdLong for m in gst])


@pytest.mark.data
@pytest.mark.parametrize("name", WITH_FIXES)
def test_real_receivers_are_read_as_pynmeagps_reads_them(data_folder, name, sound):
    path = data_folder / "nmea_gst" / f"{name}.log"
    (drive,) = read_drive(path)
    sound(drive)
    found = {}
    with path.open("rb") as stream:
        for _, m in NMEAReader(stream, validate=1, quitonerror=0):
            if m is not None and m.msgID == "GGA" and m.quality and m.lat != "" and m.time != "":
                found.setdefault(m.time, (m.lat, m.lon))
    assert len(drive.fixes) == len(found) > 0
    place = np.array(list(found.values()), float)
    assert np.abs(np.sort(drive.fixes.lat_deg) - np.sort(place[:, 0])).max() < 2e-8
    assert np.abs(np.sort(drive.fixes.lon_deg) - np.sort(place[:, 1])).max() < 2e-8


@pytest.mark.data
def test_a_real_log_without_a_fix_is_refused_with_the_reason(data_folder):
    with pytest.raises(ReadError, match="epoch without a fix: 10"):
        read_drive(data_folder / "nmea_gst" / "ublox-lea-5q.log")


@pytest.mark.data
def test_most_real_ellipses_are_used_or_flagged(data_folder):
    for name in WITH_FIXES:
        fixes = read_drive(data_folder / "nmea_gst" / f"{name}.log")[0].fixes
        assert (fixes.cov_ee * fixes.cov_nn > fixes.cov_en**2).all()
        uncorrelated = fixes.flags != 0
        assert (fixes.cov_en[uncorrelated] == 0).all()


def covariance(sigma_lat, sigma_lon, major, minor, bearing):
    """What the reader makes of one GST."""
    values = (np.array([float(v)]) for v in (sigma_lat, sigma_lon, major, minor, bearing))
    ee, en, nn, doubt = from_gst(*values)
    return float(ee[0]), float(en[0]), float(nn[0]), bool(doubt[0])


@given(
    st.floats(0.5, 20),
    st.floats(0.5, 20),
    st.floats(0, 180),
    st.sampled_from([1.0, 2.4477]),
)
def test_an_ellipse_of_one_sigma_or_of_95_percent_gives_the_whole_covariance(a, b, angle, times):
    major, minor = max(a, b), min(a, b)
    direction = np.array([np.sin(np.radians(angle)), np.cos(np.radians(angle))])
    across = np.array([direction[1], -direction[0]])
    cov = major**2 * np.outer(direction, direction) + minor**2 * np.outer(across, across)
    sigmas = np.sqrt(cov[1, 1]), np.sqrt(cov[0, 0])
    ee, en, nn, doubt = covariance(*sigmas, times * major, times * minor, angle)
    assert [ee, nn] == pytest.approx([cov[0, 0], cov[1, 1]])
    # a needle's correlation is not believed
    if abs(cov[0, 1]) < 0.9998 * np.sqrt(ee * nn):
        assert not doubt
        assert en == pytest.approx(cov[0, 1], abs=1e-9 * (ee + nn))


def test_an_ellipse_of_another_size_gives_no_correlation_and_a_flag(nmea, read):
    fixes = read(nmea.burst(gst="9.0,4.5,30.0,2.0,1.5")).fixes
    assert fixes.cov_en[0] == 0
    assert fixes.flags[0] == NO_CORRELATION
    assert [fixes.cov_ee[0], fixes.cov_nn[0]] == pytest.approx([1.5**2, 2.0**2])


def test_a_gst_without_an_ellipse_keeps_its_sigmas(nmea, read):
    fixes = read(nmea.burst(gst=",,,2.0,1.5")).fixes
    assert [fixes.cov_ee[0], fixes.cov_en[0], fixes.cov_nn[0]] == pytest.approx([2.25, 0, 4.0])
    assert fixes.flags[0] == NO_CORRELATION


@pytest.mark.parametrize("gst", [None, "0.0,0.0,0.0,0.0,0.0", ",,,,"])
def test_without_a_gst_or_with_zeros_hdop_decides_and_is_flagged(nmea, read, gst):
    fixes = read(nmea.burst(gst=gst, hdop="1.5")).fixes
    sigma = 1.5 * Settings().user_range_error_m
    assert [fixes.cov_ee[0], fixes.cov_en[0], fixes.cov_nn[0]] == pytest.approx(
        [sigma**2, 0, sigma**2]
    )
    assert fixes.flags[0] == FROM_HDOP


@pytest.mark.parametrize("hdop", ["99.99", "99.9", "99.0"])
def test_a_hdop_that_stands_for_unknown_is_none(nmea, read, hdop):
    drive = read(nmea.burst(gst=None, hdop=hdop))
    assert drive.fixes.flags.tolist() == [ASSUMED]
    assert drive.skipped == {"HDOP of 99, 99.9 or 99.99 (taken as unknown)": 1}


def test_without_gst_and_hdop_the_default_is_taken_and_flagged(nmea, read):
    fixes = read(nmea.burst(gst=None, hdop="")).fixes
    assert fixes.cov_ee[0] == Settings().default_sigma_m ** 2
    assert fixes.flags[0] == ASSUMED


def gns(nmea, modes, hdop="0.8", clock="080000.00"):
    """A GNS of one epoch, with its date."""
    place = f"{nmea.angle(49.4, 2, 'NS')},{nmea.angle(8.7, 3, 'EW')}"
    body = f"GNGNS,{clock},{place},{modes},19,{hdop},52.0,45.0,,,V"
    return nmea.sealed(body) + nmea.sealed(f"GNZDA,{clock[:6]},01,06,2026,00,00")


KINDS_OF_FIXES = [(4, "RNNN", 0.03), (5, "FFNN", 0.4), (2, "DAN", 4.0), (1, "AAAA", 4.0),
                  (6, "EE", 10.0), (8, "S", 4.0)]  # fmt: skip


@pytest.mark.parametrize(("quality", "modes", "error"), KINDS_OF_FIXES)
def test_the_kind_of_fix_decides_where_no_error_is_reported(nmea, read, quality, modes, error):
    for content in (nmea.burst(gst=None, quality=quality, hdop="0.8"), gns(nmea, modes)):
        fixes = read(content).fixes
        sigma = 0.8 * error
        assert [fixes.cov_ee[0], fixes.cov_en[0], fixes.cov_nn[0]] == pytest.approx(
            [sigma**2, 0, sigma**2]
        )
        expected = FROM_HDOP | (FROM_QUALITY if error != 4.0 else 0)
        assert fixes.flags[0] == expected | (RECKONED_PLACE if quality == 6 else 0)
        parser = NmeaParser()
        (live,) = parser.feed(content) + parser.flush()
        assert [live.cov_ee, live.cov_nn] == [fixes.cov_ee[0], fixes.cov_nn[0]]


def test_an_rmc_alone_says_that_its_place_is_dead_reckoned(nmea, read):
    place = f"{nmea.angle(49.4, 2, 'NS')},{nmea.angle(8.7, 3, 'EW')}"
    ends = [",,,A", ",,,E", ",,,E,V", ",,,R", ""]
    content = b"".join(
        nmea.sealed(f"GPRMC,08000{k}.00,A,{place},20.0,90.0,010626{end}")
        for k, end in enumerate(ends)
    )
    fixes = read(content).fixes
    factor = np.sqrt(fixes.cov_ee) / Settings().default_sigma_m
    assert factor == pytest.approx([1.0, 2.5, 2.5, 1.0, 1.0])
    assert (fixes.flags & RECKONED_PLACE > 0).tolist() == [False, True, True, False, False]
    gga = nmea.burst(clock="080001.00", gst=None, knots=None)  # says that it has satellites
    assert not (read(content + gga).fixes.flags[1] & RECKONED_PLACE)


@pytest.mark.parametrize("pieces", [[1, 1, 1, 1], [1, 3], [2, 2], [4]])
def test_an_rmc_without_a_mode_takes_none_of_its_variation_or_the_next_sentence(nmea, pieces):
    place = f"{nmea.angle(49.4, 2, 'NS')},{nmea.angle(8.7, 3, 'EW')}"
    lines = [
        nmea.sealed(f"GPRMC,08000{k}.00,A,{place},20.0,90.0,010626,003.1,E") for k in range(3)
    ] + [b"$E,E*00\r\n"]
    parser = NmeaParser(today=NOON, beside=lambda _: True)  # a dead-reckoned one is left out
    fixes = []
    for n in pieces:
        fixes += parser.feed(b"".join(lines[:n]))
        del lines[:n]
    fixes += parser.flush()
    assert [fix.cov_ee for fix in fixes] == [Settings().default_sigma_m ** 2] * 3
    assert LEFT_OUT not in parser.skipped


def test_a_reported_error_comes_before_the_kind_of_fix(nmea, read):
    fixes = read(nmea.burst(gst="0.9,0.7,30.0,0.8,0.8", quality=4)).fixes
    assert [fixes.cov_ee[0], fixes.cov_nn[0]] == pytest.approx([0.64, 0.64])
    assert not fixes.flags[0] & FROM_QUALITY


def test_a_kind_of_fix_without_a_hdop_is_a_part_of_the_default(nmea, read):
    fixes = read(nmea.burst(gst=None, hdop="", quality=5)).fixes
    assert fixes.cov_ee[0] == pytest.approx((0.1 * Settings().default_sigma_m) ** 2)
    assert fixes.flags[0] == ASSUMED | FROM_QUALITY


def test_the_settings_scale_all_kinds_of_fixes_but_none_falls_below_a_centimetre(nmea, put):
    for scale, quality, sigma in ((8.0, 5, 0.8), (0.4, 4, 0.01), (0.4, 2, 0.4)):
        path = put("log.nmea", nmea.burst(gst=None, quality=quality, hdop="1.0"))
        (drive,) = read_drive(path, settings=Settings(user_range_error_m=scale))
        assert np.sqrt(drive.fixes.cov_ee) == pytest.approx(sigma)


def test_a_log_of_gns_alone_is_read_and_modes_without_a_fix_are_left_out(nmea, read):
    clocks = [f"08000{k}.00" for k in range(4)]
    modes = ["AA", "NN", "NNNNNR", "AN"]
    drive = read(b"".join(gns(nmea, m, clock=c) for m, c in zip(modes, clocks, strict=True)))
    assert np.diff(drive.fixes.time).tolist() == [2.0, 1.0]
    assert drive.skipped == {"epoch without a fix": 1}
    assert np.sqrt(drive.fixes.cov_ee) == pytest.approx([3.2, 0.024, 3.2])


def test_a_gga_comes_before_a_gns_of_its_epoch(nmea, read):
    both = nmea.burst(gst=None, quality=4) + gns(nmea, "AAAA")
    assert np.sqrt(read(both).fixes.cov_ee) == pytest.approx([0.9 * 0.03])


def test_the_date_rolls_over_at_midnight(nmea, read):
    clocks = [("235958.50", "311225"), ("235959.50", "311225"), ("000000.50", None)]
    clocks += [("000001.50", None), ("000002.50", "010126")]
    fixes = read(b"".join(nmea.burst(clock=c, date=d) for c, d in clocks)).fixes
    assert np.diff(fixes.time) == pytest.approx(np.ones(4))
    assert np.datetime64(int(fixes.time[0]), "s") == np.datetime64("2025-12-31T23:59:58")


def test_midnight_needs_no_date_and_says_so(nmea, read):
    content = nmea.burst("235959.00", knots=None) + nmea.burst("000000.00", knots=None)
    drive = read(content)
    assert np.diff(drive.fixes.time) == pytest.approx([1.0])
    assert any("no date" in note for note in drive.notes)


def test_the_date_may_come_from_zda_after_the_first_fix(nmea, read):
    content = nmea.burst("120000.00", knots=None) + nmea.sealed("GNZDA,120000.00,01,06,2026,00,00")
    assert read(content).fixes.time == pytest.approx([NOON])


def test_talkers_may_be_mixed(nmea, read):
    place = f"{nmea.angle(49.4, 2, 'NS')},{nmea.angle(8.7, 3, 'EW')}"
    content = b"".join(
        nmea.sealed(body)
        for body in (
            f"GNRMC,120000.00,A,{place},20.0,90.0,010626,,,A",
            f"GPGGA,120000.00,{place},1,09,0.9,52.0,M,45.0,M,,",
            "GLGST,120000.00,1.2,,,,2.0,1.5,3.0",
            "GAGSA,A,3,04,09,16,,,,,,,,,,1.2,0.9,0.7",
        )
    )
    drive = read(content)
    assert len(drive.fixes) == 1
    assert drive.fixes.cov_nn[0] == pytest.approx(4.0)
    assert any("GSA" in note for note in drive.notes)


def test_sentences_that_a_sensor_would_read_are_noted_with_it_until_it_is_there(nmea, put):
    place = f"{nmea.angle(49.4, 2, 'NS')},{nmea.angle(8.7, 3, 'EW')}"
    bodies = [f"GNRMC,120000.00,A,{place},20.0,90.0,010626,,,A", "GPHDT,91.0,T", "GPHDT,91.0,T"]
    path = put("drive.nmea", b"".join(map(nmea.sealed, bodies)))
    (drive,) = read_drive(path)
    assert drive.notes == ("sentences not needed: 2 HDT (--sensor DualAntenna reads them)",)
    (drive,) = read_drive(path, columns=columns_of([DualAntenna()]))
    assert drive.notes == ()


def test_vtg_gives_speed_where_rmc_is_absent(nmea, read):
    content = nmea.burst("120000.00", knots=None) + nmea.sealed("GPVTG,45.0,T,,M,20.0,N,37.0,K,A")
    fixes = read(content).fixes
    assert fixes.speed[0] == pytest.approx(20 * KNOT)
    assert fixes.bearing_deg[0] == pytest.approx(45.0)


def test_a_standing_receiver_has_no_course(nmea, read):
    fixes = read(nmea.burst(knots=0.1)).fixes
    assert np.isinf(fixes.sigma_bearing_deg[0])
    assert np.isfinite(fixes.sigma_speed[0])


def test_epochs_without_a_fix_are_counted(nmea, read, sound):
    content = log_of(nmea, 3) + nmea.sealed("GPGGA,120010.00,,,,,0,00,99.9,,M,,M,,")
    drive = read(content)
    sound(drive)
    assert len(drive.fixes) == 3
    assert drive.skipped == {"epoch without a fix": 1}


def test_wrong_checksums_and_cut_sentences_are_counted(nmea, read, sound):
    lines = log_of(nmea, 4).splitlines(keepends=True)
    lines[0] = lines[0].replace(b",1,09,", b",1,08,")
    lines[3] = lines[3][:30] + b"\r\n"
    drive = read(b"".join(lines))
    sound(drive)
    assert len(drive.fixes) == 4  # RMC of those epochs still has a position
    assert drive.skipped["wrong checksum"] == 1
    assert drive.skipped["sentence cut short"] == 1


def test_bytes_between_sentences_are_passed_over(nmea, read, sound):
    rng = np.random.default_rng(3)
    noise = rng.bytes(400).replace(b"$", b"").replace(b"\n", b"")
    clean = log_of(nmea, 10)
    drive = read(clean.replace(b"$GPGST", noise + b"\n$GPGST"))
    sound(drive)
    assert np.array_equal(drive.fixes.lat_deg, read(clean).fixes.lat_deg)
    assert not drive.skipped


def test_time_running_backwards_is_put_in_order_and_counted(nmea, read, sound):
    clocks = ["120000.00", "120002.00", "120001.00", "120003.00"]
    drive = read(b"".join(nmea.burst(clock=c) for c in clocks))
    sound(drive)
    assert drive.fixes.time == pytest.approx(NOON + np.arange(4.0))
    assert sum(drive.skipped.values()) == 1


def test_impossible_positions_are_counted(nmea, read, sound):
    bad = nmea.burst("120005.00", lat=0.0, lon=0.0)
    drive = read(log_of(nmea, 3) + bad)
    sound(drive)
    assert len(drive.fixes) == 3
    assert drive.skipped == {"impossible position": 1}


@pytest.mark.parametrize("piece", [1, 7, 100, 4096])
def test_a_stream_in_pieces_gives_the_fixes_of_the_whole_log(nmea, read, piece):
    content = log_of(nmea, 30)
    parser = NmeaParser()
    fixes = [
        fix for k in range(0, len(content), piece) for fix in parser.feed(content[k : k + piece])
    ]
    fixes += parser.flush()
    assert fixes == as_records(read(content).fixes)
    assert not parser.skipped


@pytest.mark.data
@pytest.mark.parametrize("piece", [113, 1000])
def test_real_streams_in_pieces_give_the_fixes_of_the_whole_log(data_folder, piece):
    for name in WITH_FIXES:
        path = data_folder / "nmea_gst" / f"{name}.log"
        content, parser = path.read_bytes(), NmeaParser()
        fixes = [
            fix
            for k in range(0, len(content), piece)
            for fix in parser.feed(content[k : k + piece])
        ]
        fixes += parser.flush()
        assert fixes == as_records(read_drive(path)[0].fixes), path.name


def test_a_fix_comes_out_in_a_pause_but_not_in_the_middle_of_a_sentence(nmea):
    parser, content = NmeaParser(), nmea.burst()
    assert parser.feed(content[:-5]) + parser.pause() == []
    assert parser.feed(content[-5:]) == []
    assert [fix.time for fix in parser.pause()] == [NOON - 4 * 3600.0]
    assert parser.pause() == []


def test_a_fix_comes_out_with_the_sentence_that_ended_three_bursts(nmea):
    parser = NmeaParser()
    bursts = [nmea.burst(clock=f"1200{k:02d}.00") for k in range(6)]
    assert [len(parser.feed(burst)) for burst in bursts] == [0, 1, 1, 2, 1, 1]


def test_a_burst_that_does_not_end_takes_no_more_memory(nmea):
    parser = NmeaParser()
    fixes = [fix for _ in range(100) for fix in parser.feed(100 * nmea.burst(knots=None))]
    assert len(fixes) == 1
    assert len(parser._bursts) <= 1000


def epochs(nmea, n, every=0.2):
    """Bursts of a receiver at some Hz, each as its sentences."""
    clocks = [f"1200{k * every:05.2f}" for k in range(n)]
    return [nmea.burst(clock=clock).splitlines(keepends=True) for clock in clocks]


def test_bursts_that_come_late_come_out_late_and_none_is_lost(nmea, read):
    rng, bursts = np.random.default_rng(3), [b"".join(one) for one in epochs(nmea, 200)]
    order = np.argsort(np.arange(200) * 0.2 + rng.uniform(0.05, 0.6, 200))
    parser = NmeaParser()
    fixes = [fix for k in order for fix in parser.feed(bursts[k])] + parser.flush()
    expected = as_records(read(b"".join(bursts)).fixes)
    assert fixes == [expected[k] for k in order]
    assert not parser.skipped


def test_a_burst_that_comes_twice_gives_one_fix_and_is_counted(nmea):
    bursts = [b"".join(one) for one in epochs(nmea, 60)]
    parser = NmeaParser()
    fixes = [fix for k in range(60) for j in (k, k - 3) for fix in parser.feed(bursts[max(j, 0)])]
    fixes += parser.flush()
    assert len({fix.time for fix in fixes}) == len(fixes) == 60
    assert parser.skipped == {"repeated time": 60}
    assert all(fix.cov_ee == pytest.approx(fixes[0].cov_ee) for fix in fixes)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("pauses", [False, True])
def test_sentences_of_different_epochs_that_come_mixed_are_joined(nmea, read, seed, pauses):
    rng, bursts = np.random.default_rng(seed), epochs(nmea, 200)
    late = [(0.2 * k + rng.uniform(0.0, 0.4), line) for k in range(200) for line in bursts[k]]
    parser, fixes = NmeaParser(today=NOON), []
    for _, line in sorted(late):
        fixes += parser.feed(line) + (parser.pause() if pauses else [])
    fixes += parser.flush()
    expected = {fix.time: fix for fix in as_records(read(b"".join(map(b"".join, bursts))).fixes)}
    assert len({fix.time for fix in fixes}) == len(fixes) == 200
    begun = 6 if pauses else 4  # until it is known that sentences come mixed
    assert sum(fix != expected[fix.time] for fix in fixes) <= begun


def test_mixed_sentences_wait_half_a_second_for_one_that_is_lost(nmea):
    bursts, parser, out = epochs(nmea, 100), NmeaParser(today=NOON), {}
    for k in range(0, 100, 2):  # two epochs, one sentence after the other; one lost
        pair = [line for both in zip(*bursts[k : k + 2], strict=True) for line in both]
        for line in pair[: -1 if k == 60 else None]:
            out |= {fix.time: k for fix in parser.feed(line)}
    assert len(out) == 100
    waited = {round((time - min(out)) / 0.2): k for time, k in out.items()}
    assert [waited[k] for k in (59, 60, 61, 62)] == [58, 60, 64, 62]


def test_a_speed_without_a_sentence_before_it_belongs_to_no_epoch(nmea, read):
    vtg = nmea.sealed("GPVTG,45.0,T,,M,20.0,N,37.0,K,A")
    assert np.isinf(read(vtg + nmea.burst(knots=None)).fixes.sigma_speed[0])


@pytest.mark.parametrize("noise", [bytes(range(256)) * 40, b"x" * 10_000, b"\n" + b"$" * 9_999])
def test_a_stream_counts_what_is_no_sentence_and_goes_on(nmea, noise):
    parser = NmeaParser()
    assert parser.feed(noise) == []
    assert parser.feed(b"\r\n" + nmea.burst()) == []
    assert len(parser.flush()) == 1
    assert sum(parser.skipped.values()) > 0


@given(st.binary(max_size=400))
def test_a_stream_takes_any_bytes(content):
    parser = NmeaParser()
    assert parser.feed(content) + parser.flush() == []


@pytest.mark.parametrize("content", [b"\xff\x00$GP", b"hello\n", b"$GPGGA,1*00\r\n", b"lat,lon\n"])
def test_what_is_no_nmea_is_refused_by_name(put, content):
    with pytest.raises(ReadError, match=r"log\.nmea: .*NMEA"):
        read_drive(put("log.nmea", content))


@given(st.integers(0, 10**6))
def test_a_cut_log_gives_its_first_fixes(cut):
    import tempfile
    from pathlib import Path

    from .conftest import burst

    content = b"".join(burst(clock=f"1200{k:02d}.00") for k in range(5))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cut.nmea"
        path.write_bytes(content[: cut % len(content)])
        try:
            (drive,) = read_drive(path)
        except ReadError:
            return
        begin = NOON if not any("no date" in note for note in drive.notes) else 12 * 3600.0
        assert (drive.fixes.time == begin + np.arange(len(drive.fixes))).all()
