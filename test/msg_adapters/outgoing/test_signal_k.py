import json
import math
import re
import uuid
from dataclasses import replace

import numpy as np
import pytest
from samples import estimates, nothing

from msg_adapters.outgoing import signal_k
from phd_jdtc_ros.core.types import UNKNOWN, Attributes
from phd_jdtc_ros.earth import SystemPlane

PLANE = SystemPlane((52.3, 4.8, 5.0))
RUN = uuid.UUID(int=5)
# The specification's pattern of an identifier.
CONTEXT = re.compile(
    r"(vessels|aircraft)\.urn:mrn:signalk:uuid:"
    r"[0-9a-f]{8}-[0-9a-f]{4}-4[0-9a-f]{3}-[89ab][0-9a-f]{3}-[0-9a-f]{12}"
)


def at(*states, **changes):
    """Return estimates of (x, vx, y, vy) rows, with track numbers from 1."""
    state = np.zeros((len(states), 5))
    state[:, :4] = states
    given = replace(estimates(len(states)), stamp_ns=1_790_000_000_250_000_000, state=state)
    return replace(given, track_id=np.arange(1, len(states) + 1), **changes)


def read(given, types=(), run=RUN, plane=PLANE):
    sent = signal_k.deltas(given, plane, types, run)
    assert all(line.count(b"\n") == 1 and line.endswith(b"\r\n") for line in sent)
    return [json.loads(line) for line in sent]


def values_of(delta):
    ((update,),) = (delta["updates"],)
    return {each["path"]: each["value"] for each in update["values"]}


def test_deltas_have_position_and_motion_in_si_units():
    first, second = read(at((0.0, 0.0, 0.0, -7.0), (1.0, 0.0, 0.0, 0.0)))
    assert CONTEXT.fullmatch(first["context"])
    update = first["updates"][0]
    assert update["timestamp"] == "2026-09-21T14:13:20.250Z"
    assert update["source"] == {"label": "phd_jdtc_ros"}
    assert values_of(first) == {
        "": {"name": "1"},
        "navigation.position": {"latitude": 52.3, "longitude": 4.8},
        "navigation.speedOverGround": 7.0,
        "navigation.courseOverGroundTrue": pytest.approx(math.pi),
    }
    assert "navigation.courseOverGroundTrue" not in values_of(second)


def test_targets_in_the_air_are_aircraft_with_an_altitude():
    known = Attributes(
        np.array([[3048.0, 0.0], [math.nan, math.nan]]),
        np.array([np.eye(2), np.full((2, 2), math.nan)]),
        np.array([0o1234, UNKNOWN]),
        np.full(2, UNKNOWN),
    )
    given = at(*[(0.0, 1.0, 0.0, 0.0)] * 2, attributes=known, class_id=np.array([0, 1]))
    first, second = read(given)
    assert [each["context"].partition(".")[0] for each in (first, second)] == [
        *("aircraft", "vessels")
    ]
    assert values_of(first)["navigation.position"]["altitude"] == 3053.0
    assert values_of(first)[""] == {"name": "1 FL100 1234"}
    groups = [each["context"].partition(".")[0] for each in read(given, ["a-u-S", "a-u-A-C"])]
    assert groups == ["vessels", "aircraft"]


def test_contexts_stay_with_a_track_within_a_run():
    given = at((0.0, 1.0, 0.0, 0.0), (9.0, 1.0, 0.0, 0.0))
    contexts = [each["context"] for each in read(given)]
    assert contexts == [each["context"] for each in read(replace(given, stamp_ns=5))]
    others = [each["context"] for each in read(given, run=uuid.UUID(int=6))]
    assert len({*contexts, *others}) == 4
    assert read(nothing()) == []
