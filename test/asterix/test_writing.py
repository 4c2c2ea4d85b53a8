import math
from collections import Counter
from dataclasses import replace

import asterix_records as made
import pytest
from asterix_reference import decoded, value

from phd_jdtc_ros.asterix import plot_stream, writing
from phd_jdtc_ros.asterix import writing as plots_out
from phd_jdtc_ros.asterix import writing as tracks_out
from phd_jdtc_ros.asterix.messages import DAY, NONE, Plot, call_sign_of, call_sign_text
from phd_jdtc_ros.asterix.writing import Source, TrackReport

NS = 10**9
FOOT = 0.3048
SOURCE = Source(25, 7, 3)
PLAIN = TrackReport(1, (0.0, 0.0), (0.0, 0.0))


def one(track, time_ns=0, source=SOURCE):
    (record,) = decoded(b"".join(tracks_out.track_blocks([track], time_ns, source)))
    assert record["category"] == 62
    return record


def random_track(rng):
    def pair(low, high):
        return tuple(float(value) for value in rng.uniform(low, high, 2))

    return TrackReport(
        number=int(rng.integers(2**16)),
        position=pair(-4e5, 4e5),
        velocity=pair(-600.0, 600.0),
        geodetic=(float(rng.uniform(-90.0, 90.0)), float(rng.uniform(-180.0, 179.9))),
        height=float(rng.uniform(-304.8, 15_000.0)),
        climb=float(rng.uniform(-40.0, 40.0)),
        code=int(rng.integers(2**12)),
        address=int(rng.integers(1, 2**24)),
        course=int(rng.integers(4)),
        vertical=int(rng.integers(4)),
        confirmed=bool(rng.integers(2)),
        coasting=bool(rng.integers(2)),
        first=bool(rng.integers(2)),
        last=bool(rng.integers(2)),
        age_s=float(rng.uniform(0.0, 60.0)),
        since_s=float(rng.uniform(0.0, 60.0)),
        position_std=pair(0.0, 1000.0),
        velocity_std=pair(0.0, 50.0),
        covariance=float(rng.uniform(-1e5, 1e5)),
        height_std=float(rng.uniform(0.0, 400.0)),
        climb_std=float(rng.uniform(0.0, 8.0)),
    )


@pytest.mark.parametrize("geometric", [False, True])
def test_another_decoder_reads_every_item_to_its_resolution(geometric):
    rng = made.rng(62)
    source = replace(SOURCE, monosensor=geometric, geometric=geometric)
    for _ in range(60):
        track = random_track(rng)
        time_ns = int(rng.integers(20_000 * 86_400 * NS, 20_001 * 86_400 * NS))
        record = one(track, time_ns, source)

        def near(true, half, *names, record=record):
            assert value(record, *names) == pytest.approx(true, abs=half * (1 + 1e-9) + 1e-9)

        assert (value(record, "I010", "SAC"), value(record, "I010", "SIC")) == (25, 7)
        assert value(record, "I015", "SID") == 3
        assert value(record, "I040", "TrkN") == track.number
        near(time_ns / NS % 86_400, 1 / 256, "I070", "ToT")
        near(track.geodetic[0], 90.0 / 2**25, "I105", "Lat")
        near(track.geodetic[1], 90.0 / 2**25, "I105", "Lon")
        near(track.position[0], 0.25, "I100", "X")
        near(track.position[1], 0.25, "I100", "Y")
        near(track.velocity[0], 0.125, "I185", "Vx")
        near(track.velocity[1], 0.125, "I185", "Vy")
        assert int(value(record, "I060", "Mode3A"), 8) == track.code
        assert int(record["I380"]["ADR"]["ADR"]["val"], 16) == track.address
        modes = {"TRANSA": track.course, "LONGA": 3, "VERTA": track.vertical, "ADF": 0}
        assert {name: value(record, "I200", name) for name in modes} == modes
        near(track.climb / FOOT * 60.0, 3.125, "I220", "RoC")
        near(track.age_s, 0.125, "I290", "TRK", "TRK")
        near(track.since_s, 0.125, "I290", "MDS", "MDS")
        near(track.position_std[0], 0.25, "I500", "APC", "APC_X")
        near(track.position_std[1], 0.25, "I500", "APC", "APC_Y")
        size = math.copysign(math.sqrt(abs(track.covariance)), track.covariance)
        near(size, 0.25, "I500", "COV", "COV_XY")
        near(track.velocity_std[0], 0.125, "I500", "ATV", "ATV_X")
        near(track.velocity_std[1], 0.125, "I500", "ATV", "ATV_Y")
        near(track.climb_std / FOOT * 60.0, 3.125, "I500", "ARC", "ARC_Acc")
        feet = track.height / FOOT
        if geometric:
            near(feet, 3.125, "I130", "Alt")
            near(track.height_std / FOOT, 3.125, "I500", "AGA", "AGA_Acc")
            assert not {"I135", "I136"} & record.keys()
        else:
            near(feet, 12.5, "I136", "MFL")
            near(feet, 12.5, "I135", "CTBA")
            near(track.height_std / FOOT, 12.5, "I500", "ABA", "ABA_Acc")
            assert "I130" not in record
        status = {
            "MON": geometric,
            "MRH": geometric,
            "SRC": 2 * geometric,
            "CNF": not track.confirmed,
        }
        assert {name: value(record, "I080", name) for name in status} == status
        ends = {"TSE": track.last, "TSB": track.first, "CST": track.coasting}
        assert {name: value(record, "I080", name) or 0 for name in ends} == ends


def test_unknown_items_are_left_out_and_wrong_ones_refused():
    record = one(PLAIN)
    assert not {"I060", "I105", "I130", "I135", "I136", "I220", "I380"} & record.keys()
    assert not {"AGA", "ABA", "ARC"} & record["I500"].keys()
    assert record["I290"].keys() == {"TRK", "PSR"}
    with pytest.raises(ValueError, match="I062/040: 3 bytes, must be 2"):
        writing.record(62, {"040": b"abc"})


@pytest.mark.parametrize(
    ("longitude", "read"),
    [(180.0, -180.0), (180.0 - 1e-7, -180.0), (-180.0, -180.0), (135.0, 135.0)],
)
def test_longitudes_at_the_date_line_are_below_180(longitude, read):
    record = one(replace(PLAIN, geodetic=(90.0, longitude)))
    assert (value(record, "I105", "Lat"), value(record, "I105", "Lon")) == (90.0, read)


@pytest.mark.parametrize(
    ("code", "address", "name"), [(NONE, NONE, "PSR"), (0, NONE, "SSR"), (0, 5, "MDS")]
)
def test_age_is_that_of_what_a_track_is_known_by(code, address, name):
    record = one(replace(PLAIN, code=code, address=address, since_s=3.5))
    assert value(record, "I290", name, name) == 3.5


@pytest.mark.parametrize(
    ("given", "ages"),
    [
        ((0.5, math.nan, math.nan), {"PSR": 0.5}),
        ((math.nan, 1.25, math.nan), {"SSR": 1.25}),
        ((12.0, math.nan, 2.5), {"PSR": 12.0, "MDS": 2.5}),
        ((0.25, 4.25, 100.0), {"PSR": 0.25, "SSR": 4.25, "MDS": 63.75}),
    ],
)
def test_ages_are_those_of_the_sensors_that_saw_the_track(given, ages):
    # With a known source its address does not make the age that of Mode S.
    record = one(replace(PLAIN, address=5, age_s=60.0, since_s=3.0, sensor_ages_s=given))
    assert record["I290"].keys() == {"TRK", *ages}
    assert {name: value(record, "I290", name, name) for name in ages} == ages
    assert value(record, "I290", "TRK", "TRK") == 60.0


@pytest.mark.parametrize("trackers", [[(1, 7)], [(2, 40_000), (1, 3), (300, 2**15 - 1)]])
def test_trackers_that_have_the_track_are_in_their_order(trackers):
    found = one(TrackReport(5, (0.0, 0.0), (0.0, 0.0), composed=tuple(trackers)))["I510"]
    read = [(part["SDPSUID"]["val"], part["STN"]["val"]) for part in found]
    assert read == [(unit % 256, number % 2**15) for unit, number in trackers]


def test_values_beyond_an_item_are_its_largest():
    far = replace(
        PLAIN,
        position=(1e9, -1e9),
        velocity=(1e5, -1e5),
        since_s=1e4,
        height=-1e6,
        position_std=(1e9, 0.0),
        covariance=-1e12,
        climb=1e6,
    )
    record = one(far)
    assert (value(record, "I100", "X"), value(record, "I100", "Y")) == (4194303.5, -4194304.0)
    assert (value(record, "I185", "Vx"), value(record, "I185", "Vy")) == (8191.75, -8192.0)
    assert value(record, "I290", "PSR", "PSR") == 63.75
    assert value(record, "I500", "APC", "APC_X") == 32767.5


def test_blocks_fit_a_datagram_at_any_time_of_day():
    assert value(one(PLAIN, 86_400 * NS - 1), "I070", "ToT") == 0.0
    tracks = [replace(PLAIN, number=number) for number in range(200)]
    blocks = tracks_out.track_blocks(tracks, 0, SOURCE)
    assert max(map(len, blocks)) <= writing.MAX_BLOCK
    assert len(blocks) < 8
    records = [record for block in blocks for record in decoded(block)]
    assert [value(record, "I040", "TrkN") for record in records] == [*range(200)]


def test_state_of_the_tracker_and_the_end_of_a_batch():
    status, end = decoded(tracks_out.status_block(3600 * NS, SOURCE, 300))
    for record in (status, end):
        assert record["category"] == 65
        assert (value(record, "I010", "SAC"), value(record, "I015", "SID")) == (25, 3)
        assert value(record, "I030", "ToD") == 3600.0
    assert (value(status, "I000", "Typ"), value(status, "I040", "OVL")) == (1, 0)
    assert value(status, "I040", "NOGO") == 0
    assert (value(end, "I000", "Typ"), value(end, "I020", "BTN")) == (2, 44)


def random_plot(rng):
    known = rng.random(6) < 0.7
    return Plot(
        int(rng.integers(2**16)),
        NONE,
        DAY,
        float(rng.uniform(0.0, 4e5)),
        float(rng.uniform(-7.0, 7.0)),
        float(rng.integers(-40, 1600)) * 7.62 if known[0] else math.nan,
        int(rng.integers(2**12)) if known[1] else NONE,
        int(rng.integers(1, 2**24)) if known[2] else NONE,
        int(rng.integers(1, 8)),
        float(rng.integers(-120, 20)) if known[3] else math.nan,
        float(rng.integers(-120, 20)) if known[4] else math.nan,
    )


def test_plots_are_read_again_to_their_resolution():
    rng, counts = made.rng(3), Counter()
    plots = [(int(rng.integers(86_400 * NS)), random_plot(rng)) for _ in range(100)]
    data = b"".join(plots_out.plot_blocks(plots))
    found = list(plot_stream.BlockReader(counts).messages(data))
    assert not counts
    for (time_ns, plot), again, record in zip(plots, found, decoded(data), strict=True):
        assert again.time_of_day == pytest.approx(time_ns * 128 / NS, abs=0.5001)
        assert again.distance == pytest.approx(plot.distance, abs=1852.0 / 512)
        off = math.remainder(again.azimuth - plot.azimuth, 2.0 * math.pi)
        assert abs(off) <= math.pi / 2**16 + 1e-12
        rest = again._replace(time_of_day=NONE, distance=plot.distance, azimuth=plot.azimuth)
        assert rest == pytest.approx(plot, nan_ok=True)
        assert value(record, "I040", "RHO") == again.distance / 1852.0


def test_antenna_reports_crossings_of_north_and_other_azimuths():
    counts = Counter()
    for azimuth, kind in ((0.0, 1), (2.0 * math.pi, 1), (-math.pi, 2), (math.pi / 2, 2)):
        data = plots_out.service_block(0x1907, 5 * NS, azimuth, 4.0)
        (found,) = plot_stream.BlockReader(counts).messages(data)
        assert (found.radar, found.time_of_day, found.kind) == (0x1907, 640, kind)
        assert found.azimuth == pytest.approx(azimuth % (2.0 * math.pi))
        assert found.rotation_s == 4.0
        (record,) = decoded(data)
        assert value(record, "I000", "MsgTyp") == kind
    assert not counts


def test_revolution_that_is_not_known_is_left_out():
    (found,) = plot_stream.BlockReader(Counter()).messages(plots_out.service_block(1, 0, 0.0, 0.0))
    assert math.isnan(found.rotation_s)


def test_tracks_of_reports_alone_and_silent_ones_are_said_to_be_so():
    heard = replace(PLAIN, alone=True, report_age_s=3.0, address=0x3C6500)
    record = one(heard)
    assert (value(record, "I080", "PSR"), value(record, "I080", "ADS")) == (1, 0)
    assert value(record, "I290", "ES", "ES") == pytest.approx(3.0)
    assert value(record, "I290", "MDS", "MDS") is None
    silent = one(replace(PLAIN, unheard=True))
    assert (value(silent, "I080", "PSR"), value(silent, "I080", "ADS")) == (0, 1)


def test_names_are_call_signs_of_their_first_letters():
    assert call_sign_text(call_sign_of("Alma-Mater of Kiel")) == "ALMAMATE"
    assert call_sign_of("") == call_sign_of("--") == NONE
