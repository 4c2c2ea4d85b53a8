"""Tracks as NMEA 0183, read back by pynmea2."""

import math
from dataclasses import replace
from datetime import time, timezone

import numpy as np
import pytest
from pyproj import Geod
from samples import estimates, nothing

from msg_adapters.outgoing import nmea
from phd_jdtc_ros.core.types import TENTATIVE, UNKNOWN, Attributes, Pose
from phd_jdtc_ros.earth import SystemPlane

pynmea2 = pytest.importorskip("pynmea2")
PLANE = SystemPlane((54.3, 10.2, 0.0))
GEOD = Geod(ellps="WGS84")
# 12:34:56.789 of some day.
STAMP_NS = (20_000 * 86_400 + 12 * 3600 + 34 * 60 + 56) * 10**9 + 789_000_000
AT_REST = Pose((0.0, 0.0), math.nan)
NORTH, EAST = 0.5 * math.pi, 0.0


def at(*states, tracks=None, **changes):
    """Return estimates of (x, vx, y, vy) rows."""
    state = np.zeros((len(states), 5))
    state[:, :4] = states
    tracks = range(1, len(states) + 1) if tracks is None else tracks
    given = replace(estimates(len(states)), stamp_ns=STAMP_NS, state=state)
    return replace(given, track_id=np.array(tracks), **changes)


def targets_of(given, numbers=None, centre=(0.0, 0.0)):
    return (numbers or nmea.TargetNumbers()).of(given, centre)


def read(sentences):
    """Return the sentences as pynmea2 parses them, with their checksums."""
    assert all(len(each) <= 82 and each.endswith(b"\r\n") for each in sentences)
    return [pynmea2.parse(each.decode("ascii"), check=True) for each in sentences]


def ttm(given, own=AT_REST, plane=None, relative=False):
    return read(nmea.ttm(targets_of(given), own, plane, relative))


def test_ttm_has_distance_bearing_speed_and_course_from_north():
    (found,) = ttm(at((3 * 1852.0, 0.0, -3 * 1852.0, 10 * 1852 / 3600)))
    assert (found.talker, found.sentence_type, found.target_number) == ("RA", "TTM", 1)
    assert float(found.distance) == pytest.approx(3 * math.sqrt(2), abs=5e-4)
    assert (float(found.bearing), found.brg_ref) == (135.0, "T")
    assert (float(found.speed), float(found.cog), found.cog_unit) == (10.0, 0.0, "T")
    assert (found.dist_unit, found.status, found.acquisition) == ("N", "T", "A")
    assert found.timestamp == time(12, 34, 56, 780_000, timezone.utc)


def test_ttm_relative_is_from_the_bow_after_own_ships_heading():
    # Own ship heads east at 20 knots, the target on its port bow goes south.
    own = Pose((100.0, 200.0), EAST, (20 * 1852 / 3600, 0.0))
    heading, found = ttm(at((1100.0, 0.0, 1200.0, -5.0)), own, relative=True)
    assert [float(v) for v in (heading.data[0], heading.data[2], heading.data[4])] == [90, 90, 20]
    assert (float(found.bearing), found.brg_ref) == (315.0, "R")
    assert (float(found.cog), found.cog_unit) == (90.0, "R")
    assert nmea.ttm(targets_of(at((1.0, 0.0, 2.0, 0.0))), AT_REST, None, True) == []


@pytest.mark.parametrize(
    ("own_velocity", "state", "distance_m", "minutes"),
    [
        # Head on, at 10 m/s each over 6 km: together after five minutes.
        ((0.0, 10.0), (0.0, 0.0, 6000.0, -10.0), 0.0, 5.0),
        # Crossing: closest where 45 degrees of the way are left.
        ((0.0, 0.0), (3000.0, 0.0, -1200.0, 10.0), 3000.0, 2.0),
        # Past: the time is negative.
        ((0.0, 0.0), (500.0, 0.0, 1200.0, 10.0), 500.0, -2.0),
    ],
)
def test_ttm_has_the_closest_point_of_approach(own_velocity, state, distance_m, minutes):
    (found,) = ttm(at(state), Pose((0.0, 0.0), NORTH, own_velocity))
    assert float(found.dist_cpa) == pytest.approx(distance_m / 1852.0, abs=5e-4)
    assert float(found.time_cpa) == pytest.approx(minutes, abs=0.05)


@pytest.mark.parametrize(
    "own_velocity", [(math.nan, math.nan), (0.0, 5.0), (0.01, 5.0)], ids=["unknown", "none", "slow"]
)
def test_ttm_leaves_out_an_approach_that_is_unknown_or_never(own_velocity):
    (found,) = ttm(at((9e5, 0.0, 9e5, 5.0)), Pose((0.0, 0.0), NORTH, own_velocity))
    assert (found.dist_cpa, found.time_cpa) == (None, None)
    assert float(found.speed) == pytest.approx(9.7)


def test_ttm_of_a_resting_target_at_own_ship_has_no_course():
    (found,) = ttm(at((0.0, 0.0, 0.0, 0.0)))
    assert (float(found.distance), found.cog) == (0.0, None)


@pytest.mark.parametrize("origin", [(54.3, 10.2, 0.0), (89.5, 100.0, 0.0), (-10.0, 179.9, 0.0)])
@pytest.mark.parametrize("bearing", [0.0, 77.0, 250.0])
def test_ttm_bearings_are_from_true_north_everywhere(origin, bearing):
    plane = SystemPlane(origin)
    own = Pose((20e3, -30e3), NORTH, (0.0, 0.0))
    latitude, longitude = map(float, plane.to_geodetic(*own.position))
    east, north, _ = GEOD.fwd(longitude, latitude, bearing, 10e3)
    x, y = map(float, plane.to_plane(north, east))
    (found,) = ttm(at((x, 0.0, y, 0.0)), own, plane)
    assert abs((float(found.bearing) - bearing + 180.0) % 360.0 - 180.0) < 0.15
    assert float(found.distance) == pytest.approx(10e3 / 1852.0, rel=1e-3)


@pytest.mark.parametrize("place", [(54.3, 10.2), (-33.9, -18.4), (89.9, 45.0), (10.0, -179.99999)])
def test_tll_has_latitude_and_longitude(place):
    plane = SystemPlane((*place, 0.0))
    x, y = map(float, plane.to_plane(*place))
    (found,) = read(nmea.tll(targets_of(at((x, 1.0, y, 0.0))), plane))
    assert (found.sentence_type, found.target_number, found.target_status) == ("TLL", 1, "T")
    assert found.latitude == pytest.approx(place[0], abs=1e-6)
    assert found.longitude == pytest.approx(place[1], abs=1e-6)
    assert found.timestamp == time(12, 34, 56, 780_000, timezone.utc)


def test_names_are_codes_or_addresses_or_track_numbers():
    unknown = np.full((3, 2), math.nan)
    known = Attributes(
        unknown,
        np.full((3, 2, 2), math.nan),
        np.array([0o1234, UNKNOWN, UNKNOWN]),
        np.array([0x3C6444, 0x3C6444, UNKNOWN]),
    )
    given = at(*[(1e3, 1.0, 0.0, 0.0)] * 3, tracks=[7, 8, 70_000], attributes=known)
    assert [each.name for each in ttm(given)] == ["1234", "3C6444", "70000"]
    assert [each.target_name for each in read(nmea.tll(targets_of(given), PLANE))] == [
        *("1234", "3C6444", "70000")
    ]
    # A sentence that is too long with its name is sent without it.
    far = at((4e5, 900.0, -4e5, 900.0), tracks=[123_456_789_012])
    (found,) = ttm(far, Pose((0.0, 0.0), NORTH, (0.0, 0.0)))
    assert (found.name, found.status) == ("", "T")
    (sentence,) = nmea.tll([targets_of(far)[0]._replace(name="Aurora " * 5)], PLANE)
    assert len(sentence) <= 82
    assert [each.target_name for each in read([sentence])] == [""]


def test_numbers_stay_with_tracks_and_a_lost_one_is_told_once():
    numbers, status = nmea.TargetNumbers(), np.array([TENTATIVE, 1, 2])

    def told(given):
        return [
            (each.number, int(each.found.track_id[each.row]), each.status)
            for each in numbers.of(given, (0.0, 0.0))
        ]

    first = at(*[(1e3 * i, 1.0, 0.0, 0.0) for i in (3, 1, 2)], tracks=[5, 9, 7], track_state=status)
    assert told(first) == [(1, 9, "T"), (2, 7, "T"), (3, 5, "Q")]
    # Asked again for the same scan, by another output.
    assert told(first) == [(1, 9, "T"), (2, 7, "T"), (3, 5, "Q")]
    second = at((5e3, 1.0, 0.0, 0.0), (1e3, 1.0, 0.0, 0.0), tracks=[7, 11])
    assert told(second) == [(1, 9, "L"), (2, 7, "T"), (3, 5, "L"), (4, 11, "T")]
    assert told(replace(nothing(), stamp_ns=STAMP_NS)) == [(2, 7, "L"), (4, 11, "L")]
    assert told(nothing()) == []


def test_numbers_are_from_1_to_99_and_for_the_nearest():
    numbers = nmea.TargetNumbers()
    rows = [(1e3 + i, 1.0, 0.0, 0.0) for i in range(10_000)]
    crowd = at(*rows[::-1])
    found = numbers.of(crowd, (0.0, 0.0))
    assert [each.number for each in found] == [*range(1, 100)]
    assert {int(each.found.position[each.row, 0]) for each in found} == {*range(1000, 1099)}
    # The nearest goes: its number is free from the next scan on, and the next nearest gets it.
    rest = at(*rows[:0:-1])
    assert sum(each.status == "L" for each in numbers.of(rest, (0.0, 0.0))) == 1
    found = numbers.of(at(*rows[:0:-1]), (0.0, 0.0))
    (last,) = (each for each in found if each.number == 1)
    assert last.found.position[last.row, 0] == 1099.0


def test_nothing_is_sent_of_nothing_or_of_unlabelled_estimates():
    assert ttm(nothing()) == []
    assert ttm(at((1.0, 1.0, 1.0, 1.0), tracks=[0])) == []


def test_name_of_the_operator_is_without_what_a_sentence_reserves():
    given = at((3000.0, 0.0, 0.0, 0.0))
    targets = nmea.TargetNumbers().of(given, (0.0, 0.0), {1: "Au*ro,ra$ é"})
    (found,) = read(nmea.ttm(targets, AT_REST, None, False))
    assert found.name == "Aurora "
