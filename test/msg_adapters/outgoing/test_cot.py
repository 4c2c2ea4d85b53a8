"""Tracks as Cursor on Target, read back by takproto."""

import math
import uuid
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from samples import estimates

from msg_adapters.outgoing import cot
from phd_jdtc_ros.core.tracks.manual import Manual
from phd_jdtc_ros.core.types import COASTING, CONFIRMED, UNKNOWN, Attributes
from phd_jdtc_ros.earth import SystemPlane

takproto = pytest.importorskip("takproto")
PLANE = SystemPlane((52.3, 4.8, 5.0))
STAMP_NS = 1_790_000_000_250_000_000
RUN = uuid.UUID(int=5)
NAMES = ("boat & barge", "plane")


def at(*states, **changes):
    """Return estimates of (x, vx, y, vy) rows, with track numbers from 1."""
    state = np.zeros((len(states), 5))
    state[:, :4] = states
    given = replace(estimates(len(states)), stamp_ns=STAMP_NS, state=state)
    return replace(given, track_id=np.arange(1, len(states) + 1), **changes)


def read(given, plane=PLANE, types=(), run=RUN, stale_s=30.0, manual=None):
    """Return the events as takproto parses their XML."""
    sent = cot.events(given, plane, NAMES, types, run, stale_s, manual or Manual())
    return [takproto.parse_proto(bytearray(event)).cotEvent for event in sent]


def test_events_have_place_motion_and_times():
    first, second = read(at((0.0, 30.0, 0.0, 0.0), (0.0, 0.0, 1e4, 0.0)))
    assert (first.lat, first.lon) == pytest.approx((52.3, 4.8), abs=1e-7)
    assert second.lat == pytest.approx(52.3 + 1e4 / 111_268, abs=1e-4)
    assert (first.detail.track.speed, first.detail.track.course) == (30.0, 90.0)
    assert (second.detail.track.speed, second.detail.track.course) == (0.0, 0.0)
    assert first.how == "m-f"
    assert first.sendTime == first.startTime == STAMP_NS // 10**6
    assert first.staleTime == first.sendTime + 30_000


def test_errors_follow_from_the_covariances_and_are_unknown_without_a_height():
    covariance = np.tile(np.eye(5), (2, 1, 1))
    # An ellipse of 40 m by 10 m to the north-east.
    turn = np.array([[1.0, -1.0], [1.0, 1.0]]) / math.sqrt(2.0)
    covariance[:, [[0], [2]], [0, 2]] = turn @ np.diag([1600.0, 100.0]) @ turn.T
    known = Attributes(
        np.array([[3000.0, 1.0], [math.nan, math.nan]]),
        np.array([np.diag([64.0, 1.0]), np.full((2, 2), math.nan)]),
        np.full(2, UNKNOWN),
        np.full(2, UNKNOWN),
    )
    states = [(0.0, 1.0, 0.0, 0.0)] * 2
    first, second = read(at(*states, covariance=covariance, attributes=known))
    assert (first.hae, first.ce, first.le) == (3005.0, 40.0, 8.0)
    assert (second.hae, second.ce, second.le) == (9999999.0, 40.0, 9999999.0)


def test_types_follow_from_class_and_identity():
    known = Attributes(
        np.full((3, 2), math.nan),
        np.full((3, 2, 2), math.nan),
        np.array([UNKNOWN, 0o1234, UNKNOWN]),
        np.array([UNKNOWN, UNKNOWN, 0x3C6444]),
    )
    given = at(*[(0.0, 1.0, 0.0, 0.0)] * 3, attributes=known, class_id=np.array([0, 1, 0]))
    assert [event.type for event in read(given)] == ["a-u-G", "a-n-A", "a-n-A"]
    types = ["a-u-S-X", "a-h-A-M-F"]
    assert [event.type for event in read(given, types=types)] == ["a-u-S-X", "a-h-A-M-F", "a-n-S-X"]
    callsigns = [event.detail.contact.callsign for event in read(given)]
    assert callsigns == ["1", "2 1234", "3 3C6444"]


def test_remarks_have_class_and_state_whatever_the_name():
    share = np.array([[0.75, 0.25], [0.25, 0.75]])
    state = np.array([COASTING, CONFIRMED])
    given = at(*[(0.0, 1.0, 0.0, 0.0)] * 2, class_probability=share, track_state=state)
    texts = [
        ElementTree.fromstring(event).findtext("detail/remarks")
        for event in cot.events(given, PLANE, NAMES, (), RUN, 1.0, Manual())
    ]
    assert texts == ["boat & barge 75%, coasting", "plane 75%, confirmed"]


def test_identifiers_stay_with_a_track_within_a_run():
    given = at((0.0, 1.0, 0.0, 0.0), (9.0, 1.0, 0.0, 0.0))
    first = [event.uid for event in read(given)]
    again = [event.uid for event in read(replace(given, stamp_ns=STAMP_NS + 10**9))]
    assert first == again
    assert len({*first, *(event.uid for event in read(given, run=uuid.UUID(int=6)))}) == 4


@pytest.mark.parametrize("place", [(89.99, 10.0), (-89.99, 0.0), (0.0, 179.9999), (0.0, -179.9999)])
def test_places_at_poles_and_the_date_line(place):
    plane = SystemPlane((*place, 0.0))
    for step in (-5e3, 5e3):
        (event,) = read(at((step, 1.0, 0.0, 0.0)), plane)
        x, y = map(float, plane.to_plane(event.lat, event.lon))
        assert (x, y) == pytest.approx((step, 0.0), abs=0.1)
        assert abs(event.lat) <= 90.0
        assert abs(event.lon) <= 180.0


def test_names_and_friends_are_those_of_the_operator():
    entries = Manual(names={1: 'A "B" <&>'}, marks={2: "friend"})
    first, second = read(at((0.0, 0.0, 0.0, 0.0), (1e3, 0.0, 0.0, 0.0)), manual=entries)
    assert first.detail.contact.callsign == 'A "B" <&>'
    assert (first.type, second.type) == ("a-u-G", "a-f-G")
