"""Aircraft: SBS-1, and frames of Mode S against published positions."""

import math
from collections import Counter

import ais_sentences as made
import pytest

from phd_jdtc_ros.transponders.aircraft import ModeSReader, read_sbs
from phd_jdtc_ros.transponders.messages import FOOT, ICAO, KNOT, NONE, OTHER, of_nacp, of_nucp

# The examples of "The 1090 megahertz riddle" (J. Sun), with the values given there.
EVEN, ODD = "8D40621D58C382D690C8AC2863A7", "8D40621D58C386435CC412692AD6"
SURFACE = "8C4841753A9A153237AEF0F275BE", "8C4841753AAB238733C8CD4020B1"
S = 10**9
PLACE = {"latitude": 51.1, "longitude": -0.5}


def feed(reader, *frames):
    return [reader.read(bytes.fromhex(frame), time_ns) for frame, time_ns in frames]


def test_sbs_is_read_by_its_columns():
    heard = read_sbs(made.sbs(call_sign="ABC12 ", height=35000, speed=450, course=270.5, **PLACE))
    assert (heard.space, heard.address, heard.name) == (ICAO, 0x4CA2D6, "ABC12")
    assert (heard.latitude, heard.longitude, heard.course) == (51.1, -0.5, 270.5)
    assert heard.height == pytest.approx(35000 * FOOT)
    assert heard.speed == pytest.approx(450 * KNOT)
    # 2021-03-04 05:06:07.123
    assert heard.own_ns == 1_614_834_367_123 * 10**6


def test_sbs_addresses_that_are_not_icaos_are_others():
    assert read_sbs(made.sbs("~2B1F00", latitude=51.1, longitude=-0.5)).space == OTHER


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (
            b"STA,,5,179,400AE7,10103,2008/11/28,14:58:51.153,,,RM",
            "other_message",
        ),
        (b"MSG,3,1,1,4CA2D6", "malformed"),
        (made.sbs("GGGGGG", latitude=1.0, longitude=1.0), "malformed"),
        (made.sbs(latitude="inf", longitude=1.0), "malformed"),
        (made.sbs(latitude="x", longitude=1.0), "malformed"),
        (made.sbs(time="25:00:00.000", latitude=1.0, longitude=1.0), "malformed"),
    ],
)
def test_sbs_lines_that_cannot_be_used_are_named(line, reason):
    assert read_sbs(line) == reason


def test_sbs_lines_without_a_time_have_none():
    assert read_sbs(made.sbs(day="", time="", latitude=1.0, longitude=1.0)).own_ns == NONE


def test_a_pair_of_frames_has_the_published_position():
    pytest.importorskip("rs1090")
    first, second = feed(ModeSReader(Counter()), (ODD, 10 * S), (EVEN, 12 * S))
    assert first is None
    assert second.latitude == pytest.approx(52.25720, abs=1e-5)
    assert second.longitude == pytest.approx(3.91937, abs=1e-5)
    assert second.height == pytest.approx(38000 * FOOT)
    assert (second.space, second.address) == (ICAO, 0x40621D)


def test_frames_far_apart_are_no_pair():
    pytest.importorskip("rs1090")
    assert feed(ModeSReader(Counter()), (ODD, 10 * S), (EVEN, 25 * S)) == [None, None]


def test_one_frame_near_a_known_place_suffices():
    pytest.importorskip("rs1090")
    found = feed(ModeSReader(Counter()), (ODD, 0), (EVEN, 1 * S), (EVEN, 20 * S), (EVEN, 60 * S))
    assert found[2].latitude == pytest.approx(found[1].latitude, abs=1e-9)
    assert found[3] is None


def test_positions_on_the_ground_need_a_place():
    pytest.importorskip("rs1090")
    counts = Counter()
    assert feed(ModeSReader(counts), (SURFACE[1], 0)) == [None]
    assert counts == {"surface_unplaced": 1}
    (heard,) = feed(ModeSReader(Counter(), (51.990, 4.375)), (SURFACE[1], 0))
    assert heard.latitude == pytest.approx(52.32304, abs=1e-5)
    assert heard.longitude == pytest.approx(4.73047, abs=1e-5)
    assert heard.speed == pytest.approx(18.0 * KNOT)


def test_velocities_and_call_signs_come_alone():
    pytest.importorskip("rs1090")
    speed, sign = feed(
        ModeSReader(Counter()),
        ("8D485020994409940838175B284F", 0),
        ("8D4840D6202CC371C32CE0576098", 0),
    )
    assert speed.speed == pytest.approx(159.20 * KNOT, abs=0.01)
    assert speed.course == pytest.approx(182.88, abs=0.01)
    assert math.isnan(speed.latitude)
    assert sign.name == "KLM1023"


def test_accuracy_categories_become_standard_deviations():
    pytest.importorskip("rs1090")
    # Target state and status, with a NACp of 9: 95 % within 30 m.
    state = bytearray.fromhex("8DA05629EA21485CBF3F8CADAEEB")
    reader = ModeSReader(Counter())
    reader.read(bytes(state), 0)
    assert reader._aircraft[ICAO, 0xA05629].std == of_nacp(9)
    assert of_nacp(9)[0] == pytest.approx(30.0 / 2.4477, abs=1e-3)


@pytest.mark.parametrize("of", [of_nacp, of_nucp])
def test_95_percent_are_within_the_radius_of_a_category(of):
    # Rayleigh: P(r < R) = 1 - exp(-R^2 / 2 s^2).
    std, accurate = of(8)
    radius = {of_nacp: 92.6, of_nucp: 10.0}[of]
    assert 1.0 - math.exp(-0.5 * (radius / std) ** 2) == pytest.approx(0.95)
    assert accurate == int(radius <= 10.0)
    assert of(0) == (50.0, 255)
    assert of(12)[0] == 50.0


def test_frames_of_damaged_and_other_formats_are_counted():
    pytest.importorskip("rs1090")
    counts = Counter()
    reader = ModeSReader(counts)
    damaged = bytearray.fromhex(EVEN)
    damaged[5] ^= 1
    assert reader.read(bytes(damaged), 0) is None
    assert reader.read(bytes.fromhex("5D484FDEA248F5"), 0) is None
    assert counts == {"malformed": 1, "other_message": 1}
