"""Positions of CAT010, CAT020, CAT021 and CAT062, beside another decoder and the specification."""

import math
from collections import Counter

import asterix_records as made
import asterix_reference
import pytest
from asterix_reference import value

from phd_jdtc_ros.asterix import framing
from phd_jdtc_ros.asterix.messages import PositionMessage
from phd_jdtc_ros.asterix.plot_stream import BlockReader, PlotStream
from phd_jdtc_ros.asterix_bridge import configuration
from phd_jdtc_ros.transponders.messages import (
    FOOT,
    ICAO,
    NONE,
    OTHER,
    TRACK_NUMBER,
    of_nacp,
    of_nucp,
)

S = 10**9
DAY_NS = 20_779 * 86_400 * S
NOON_S = 43_200
NOON_NS = DAY_NS + NOON_S * S
WHO = (("SAC", 25), ("SIC", 3))
AT = {"LAT": 52.0, "LON": 4.5}
PLACE = tuple(AT.items())
# The target report descriptor of CAT021 with one octet.
AIRBORNE = ((0, 0, 0, 0, None),)
# The figure of merit of the old editions, with a position accuracy of 8.
FIGURE = (("AC", 0), ("MN", 0), ("DC", 0), 0, ("PA", 8))
FLAGS = ("DCR", "GBS", "SIM", "TST", "RAB", "SAA", "SPI")


def read(data):
    counts = Counter()
    return list(BlockReader(counts).messages(data)), +counts


def one(number, record, edition=None):
    """Return the message of a record with a source."""
    (found,), counts = read(made.block(number, [{"010": WHO, **record}], edition))
    assert not counts
    return found


def squitter(**items):
    """Return the items of a report of CAT021 of edition 2; others by their names."""
    given = {name.removeprefix("i"): item for name, item in items.items()}
    usual = {"040": AIRBORNE, "071": made.ticks(NOON_S), "131": PLACE, "080": 0x40621D}
    return {**usual, **given}


def old_squitter(position=PLACE, **items):
    """Return the items of a report of CAT021 of edition 0.26."""
    given = {name.removeprefix("i"): item for name, item in items.items()}
    return {
        "040": (*((name, 0) for name in FLAGS), 0, ("ATP", 1), ("ARC", 0), 0),
        "030": made.ticks(NOON_S),
        "130": position,
        "080": 0x40621D,
        **given,
    }


def assert_near(found, wanted, within=1e-9):
    assert found == pytest.approx(math.nan if wanted is None else wanted, abs=within, nan_ok=True)


def assert_velocity(heard, east, north):
    if east is None:
        assert math.isnan(heard.speed)
        return
    course = math.radians(heard.course)
    assert_near(heard.speed * math.sin(course), east, 1e-6)
    assert_near(heard.speed * math.cos(course), north, 1e-6)


def test_ads_b_is_what_another_decoder_reads():
    rng = made.rng(21)
    data = b""
    for _ in range(150):
        items = {
            "073": made.ticks(float(rng.uniform(0, 86_399))),
            "130": (("LAT", float(rng.uniform(-89, 89))), ("LON", float(rng.uniform(-179, 179)))),
            "140": float(rng.integers(-1000, 40_000)),
            "145": float(rng.integers(-10, 450)),
            "160": (
                ("RE", 0),
                ("GS", float(rng.uniform(0, 0.2))),
                ("TA", float(rng.uniform(0, 359))),
            ),
            "020": int(rng.integers(1, 24)),
        }
        kept = {name: item for name, item in items.items() if rng.random() < 0.7}
        kept["080"] = int(rng.integers(1, 2**24))
        data += made.block(21, [{"010": WHO, **squitter(**kept)}])
    found, counts = read(data)
    assert not counts
    for own, record in zip(found, asterix_reference.decoded(data), strict=True):
        heard = own.heard
        assert own.time_of_day / 128.0 == value(record, "I071", "time_applicability_position")
        assert_near(heard.latitude, value(record, "I131", "Lat"))
        assert_near(heard.longitude, value(record, "I131", "Lon"))
        assert heard.address == int(value(record, "I080", "TAddr"), 16)
        level, height = value(record, "I145", "FL"), value(record, "I140", "geometric_height")
        feet = height if level is None else 100.0 * level
        assert_near(heard.height, None if feet is None else feet * FOOT, 1e-6)
        speed = value(record, "I160", "GS")
        assert_near(heard.speed, None if speed is None else speed * 1852.0, 1e-6)
        assert_near(heard.course, value(record, "I160", "TA"), 1e-6)
        assert heard.type == (value(record, "I020", "ECAT") or 0)


def test_multilateration_is_what_another_decoder_reads():
    rng = made.rng(20)
    data = b""
    for _ in range(150):
        items = {
            "202": (("VX", float(rng.uniform(-90, 90))), ("VY", float(rng.uniform(-90, 90)))),
            "090": (("V", int(rng.integers(2))), ("G", 0), ("FL", float(rng.integers(-4, 400)))),
            "105": float(rng.integers(0, 1000)),
            "161": (0, ("TRN", int(rng.integers(4096)))),
            "220": int(rng.integers(1, 2**24)),
            "500": {
                **({"DOP": (("X", 1.0), ("Y", 1.0), ("XY", 1.0))} if rng.random() < 0.5 else {}),
                "SDP": (
                    ("X", float(rng.integers(1, 99))),
                    ("Y", float(rng.integers(1, 99))),
                    ("XY", 0.0),
                ),
            },
        }
        kept = {name: item for name, item in items.items() if rng.random() < 0.7}
        place = (("LAT", float(rng.uniform(-89, 89))), ("LON", float(rng.uniform(-179, 179))))
        time = made.ticks(float(rng.uniform(0, 86_399)))
        usual = {"020": ((0, 1, 0, 0, 0, 0, 0, None),), "140": time, "041": place}
        data += made.block(20, [{"010": WHO, **usual, **kept}])
    found, counts = read(data)
    assert not counts
    for own, record in zip(found, asterix_reference.decoded(data), strict=True):
        heard = own.heard
        assert own.time_of_day / 128.0 == value(record, "I140", "ToD")
        assert_near(heard.latitude, value(record, "I041", "Lat"))
        assert_near(heard.longitude, value(record, "I041", "Lon"))
        assert_velocity(heard, value(record, "I202", "Vx"), value(record, "I202", "Vy"))
        address = value(record, "I220", "TAddr")
        if address is not None:
            assert (heard.space, heard.address) == (ICAO, int(address, 16))
        else:
            assert heard.space == TRACK_NUMBER
            assert heard.address == (NONE if "I161" not in record else _track_number(record))
        for own_std, name in ((heard.x_std, "SDPx"), (heard.y_std, "SDPy")):
            std = value(record, "I500", "SDP", name) if "I500" in record else None
            assert own_std == (50.0 if std is None else std)
        usable = "I090" in record and not value(record, "I090", "V")
        feet = 100.0 * value(record, "I090", "FL") if usable else None
        feet = _first_of(record, "I105") if feet is None else feet
        assert_near(heard.height, None if feet is None else feet * FOOT, 1e-6)


def _first_of(record, item):
    return next(iter(record[item].values()))["val"] if item in record else None


def _track_number(record):
    return next(part["val"] for name, part in record["I161"].items() if "spare" not in name.lower())


def test_surface_positions_are_what_another_decoder_reads():
    rng = made.rng(10)
    data = b""
    for _ in range(100):
        place = (("LAT", float(rng.uniform(-89, 89))), ("LON", float(rng.uniform(-179, 179))))
        record = {
            "010": WHO,
            "000": 1,
            "020": ((int(rng.choice([0, 1, 2, 5])), 0, 0, 0, 0, None),),
            "140": made.ticks(float(rng.uniform(0, 86_399))),
            "041": place,
            "220": int(rng.integers(1, 2**24)),
            "500": (
                ("DEVX", float(rng.integers(1, 60))),
                ("DEVY", float(rng.integers(1, 60))),
                ("COVXY", 0.0),
            ),
        }
        data += made.block(10, [{**record, "202": (("VX", 0.0), ("VY", 0.0))}])
    found, counts = read(data)
    assert not counts
    for own, record in zip(found, asterix_reference.decoded(data), strict=True):
        heard = own.heard
        assert_near(heard.latitude, value(record, "I041", "Lat"))
        assert_near(heard.longitude, value(record, "I041", "Lon"))
        assert heard.address == int(value(record, "I220", "TAddr"), 16)
        assert heard.x_std == value(record, "I500", "Qx")
        assert heard.y_std == value(record, "I500", "Qy")
        assert_velocity(heard, value(record, "I202", "Vx"), value(record, "I202", "Vy"))


def test_velocities_of_cat010_are_in_quarters_as_another_decoder_reads_them():
    plain = made.block(10, [{"010": WHO, "020": ((1, 0, 0, 0, 0, None),), "041": PLACE}])
    (record,) = asterix_reference.decoded(_with_velocity(plain, 160, -200))
    (found,), _ = read(_with_velocity(plain, 160, -200))
    assert (value(record, "I202", "Vx"), value(record, "I202", "Vy")) == (40.0, -50.0)
    assert_velocity(found.heard, 40.0, -50.0)


def _with_velocity(block, east, north):
    """Return a block of a record of 010, 020 and 041 with I010/202 behind it."""
    fields, items = bytes([0xA9, 0x40]), block[4:]
    body = (
        fields
        + items
        + east.to_bytes(2, "big", signed=True)
        + north.to_bytes(2, "big", signed=True)
    )
    return bytes([10]) + (len(body) + 3).to_bytes(2, "big") + body


def test_a_real_recording_of_tracks_is_what_another_decoder_reads():
    data = asterix_reference.sample("cat062cat065.raw")
    tracks = 0
    for received in framing.datagrams(data, None, Counter()):
        found, _ = read(received.data)
        found = [each for each in found if isinstance(each, PositionMessage)]
        records = [r for r in asterix_reference.decoded(received.data) if r["category"] == 62]
        records = [
            r for r in records if not value(r, "I080", "CST") and not value(r, "I080", "TSE")
        ]
        for own, record in zip(found, records, strict=True):
            heard = own.heard
            assert own.time_of_day / 128.0 == value(record, "I070", "ToT")
            assert (heard.space, heard.address) == (TRACK_NUMBER, value(record, "I040", "TrkN"))
            assert_near(heard.latitude, value(record, "I105", "Lat"))
            assert_near(heard.longitude, value(record, "I105", "Lon"))
            assert_velocity(heard, value(record, "I185", "Vx"), value(record, "I185", "Vy"))
            level = value(record, "I136", "MFL")
            if level is not None:
                assert_near(heard.height, level * FOOT, 1e-6)
            if "I380" in record and record["I380"].get("ID"):
                sign = next(iter(record["I380"]["ID"].values()))["val"]
                assert heard.name == sign.strip() or "I245" in record
            tracks += 1
    assert tracks > 0


def test_tracks_have_their_accuracies_and_correlation():
    track = {"070": made.ticks(NOON_S), "105": PLACE, "040": 7}
    heard = one(62, {**track, "500": {"APC": (("X", 30.0), ("Y", 40.0)), "COV": -20.0}}).heard
    assert (heard.x_std, heard.y_std) == (30.0, 40.0)
    assert heard.correlation == pytest.approx(-400.0 / 1200.0)
    heard = one(62, {**track, "500": {"APC": (("X", 30.0), ("Y", 40.0))}}).heard
    assert heard.correlation == 0.0
    assert one(62, track).heard.x_std == 50.0


def test_heights_of_tracks_are_measured_or_calculated():
    track = {"070": made.ticks(NOON_S), "105": PLACE, "040": 7}
    assert one(62, {**track, "135": (("QNH", 1), ("CTB", -2.5))}).heard.height == pytest.approx(
        -76.2
    )
    assert one(62, {**track, "130": 1000.0}).heard.height == pytest.approx(304.8)


@pytest.mark.parametrize(
    ("nic", "version", "nacp", "wanted"),
    [
        (7, 2, 9, of_nacp(9)),
        (7, 1, 10, of_nacp(10)),
        (7, 0, 0, of_nucp(7)),
        (7, 2, None, of_nacp(0)),
    ],
)
def test_ads_b_has_the_standard_deviation_of_its_category(nic, version, nacp, wanted):
    quality = ((0, nic, None),) if nacp is None else ((0, nic, 1), (0, 3, nacp, None))
    mops = (0, ("VNS", 0), ("VN", version), ("LTT", 2))
    heard = one(21, squitter(i090=quality, i210=mops)).heard
    assert (heard.x_std, heard.accurate) == wanted


@pytest.mark.parametrize("edition", [(0, 26), (0, 25), (0, 24), (0, 23)])
def test_old_editions_are_told_by_their_form(edition):
    heard = one(21, old_squitter(i145=350.0, i090=FIGURE), edition).heard
    assert heard.latitude == pytest.approx(52.0, abs=3e-5)
    assert heard.longitude == pytest.approx(4.5, abs=3e-5)
    assert (heard.space, heard.address) == (ICAO, 0x40621D)
    assert heard.height == pytest.approx(35_000 * FOOT)
    assert heard.x_std == of_nacp(8)[0]


def test_a_source_of_an_old_edition_stays_one():
    rng = made.rng(26)
    counts = Counter()
    reader = BlockReader(counts)
    for _ in range(2000):
        place = (("LAT", float(rng.uniform(-89, 89))), ("LON", float(rng.uniform(-179, 179))))
        record = old_squitter(
            place, i080=int(rng.integers(1, 2**24)), i030=int(rng.integers(86_400 * 128))
        )
        more = {"140": 1000.0, "145": 35.0, "020": 3, "160": (("GS", 0.1), ("TA", 90.0))}
        record |= {name: item for name, item in more.items() if rng.random() < 0.5}
        (found,) = reader.messages(made.block(21, [{"010": WHO, **record}], (0, 26)))
        assert found.heard.latitude == pytest.approx(place[0][1], abs=1e-5)
    assert not +counts


@pytest.mark.parametrize(("atp", "space"), [(0, ICAO), (1, ICAO), (2, OTHER), (3, OTHER)])
def test_address_types_are_spaces(atp, space):
    assert one(21, squitter(i040=((atp, 0, 0, 0, None),))).heard.space == space


MORE = 0, 0, 0, 0, 1
MONITOR, TEST = ((0, 0, 0, 1, None),), (MORE, (0, 0, 0, 1, 0, 0, None))
REFUSED = (MORE, (0, 0, 0, 0, 0, 0, 1), (0, 0, 0, 0, 1, 0, 0, None))
ENDED = ((0, 0, 0, 0, 0, 1), (0, 1, 0, 0, 0, 0, 0, None))


@pytest.mark.parametrize(
    ("number", "record", "reason"),
    [
        (21, squitter(i040=MONITOR), "field_monitor"),
        (21, squitter(i040=TEST), "test_target"),
        (21, squitter(i040=REFUSED), "position_check"),
        (62, {"070": 5, "105": PLACE, "080": ENDED}, "no_detection"),
        (20, {"020": ((0, 1, 0, 0, 0, 0, 0, None),), "140": 5}, "no_position"),
        (62, {"070": 5}, "no_position"),
    ],
    ids=["monitor", "test", "check", "ended", "no place", "no track's place"],
)
def test_records_that_are_not_used_are_counted_by_reason(number, record, reason):
    found, counts = read(made.block(number, [{"010": WHO, **record}]))
    assert found == []
    assert counts == {reason: 1}


def stream(**more):
    return PlotStream({}, locate=configuration.locate, **more)


def block_of(time_s, latitude=52.0, **items):
    place = (("LAT", latitude), ("LON", 4.5))
    return made.block(21, [{"010": WHO, **squitter(i071=made.ticks(time_s), i131=place, **items)}])


def test_positions_become_batches_of_their_source():
    found = stream()
    batches = []
    for k in range(20):
        batches += found.feed(block_of(NOON_S + k / 4, 52.0 + k / 1000), NOON_NS + k * S // 4)
    batches += found.finish()
    assert {state.settings.name for state, _ in batches} == {"adsb_25_3"}
    reports = [report for _, batch in batches for report in batch.reports]
    assert [report.time_ns - DAY_NS - NOON_S * S for report in reports] == [
        k * S // 4 for k in range(20)
    ]
    (state,) = found.radars.values()
    assert (state.positions, state.plots, state.source) == (20, 0, "adsb")


def test_yesterdays_times_are_left_out():
    found = stream()
    for k in range(20):
        found.feed(block_of(NOON_S + k, 52.0 + k / 1000), NOON_NS + k * S)
    # An hour old, as it was a day before: one message does not show that the clock is wrong.
    assert found.feed(block_of(NOON_S - 3600, 53.0), NOON_NS + 20 * S) == []
    (state,) = found.radars.values()
    assert (state.positions, state.counts["time_off"]) == (20, 1)


def test_midnight_is_passed():
    found = stream()
    begin_ns = DAY_NS + 86_395 * S
    for k in range(10):
        found.feed(block_of((86_395 + k) % 86_400, 52.0 + k / 1000), begin_ns + k * S)
    (state,) = found.radars.values()
    assert state.positions == 10
    assert not +state.counts


def test_places_in_a_plane_need_the_place_of_their_source():
    record = {"010": WHO, "020": ((0, 1, 0, 0, 0, 0, 0, None),), "140": made.ticks(NOON_S)}
    block = made.block(20, [{**record, "042": (("X", 3000.0), ("Y", -4000.0)), "220": 5}])
    found = stream()
    assert not found.feed(block, NOON_NS) + found.finish()
    (state,) = found.radars.values()
    assert state.counts["place_unknown"] == 1
    bridge = configuration.resolve(
        {"radars": ["apron"], "apron.source": [25, 3], "apron.geodetic": [52.0, 4.5, 0.0]}
    )
    found = bridge.stream(found.clock)
    found.feed(block, NOON_NS)
    ((state, batch),) = found.finish()
    assert state.settings.name == "apron"
    heard = batch.reports[0].heard
    # A degree of latitude is 111.3 km there, and one of longitude 68.7 km (WGS84).
    assert (heard.latitude - 52.0) * 111_265 == pytest.approx(-4000.0, abs=5.0)
    assert (heard.longitude - 4.5) * 68_678 == pytest.approx(3000.0, abs=5.0)


def test_a_flood_of_one_address_is_bounded():
    found = stream()
    for k in range(1000):
        found.feed(block_of(NOON_S, 50.0 + k / 1000), NOON_NS)
    (state,) = found.radars.values()
    assert state.positions == 10
    assert found.counts["too_many"] == 990
