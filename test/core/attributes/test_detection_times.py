"""When each kind of sensor saw a target."""

import numpy as np
import pytest
import tower
from tower import PERIOD_S

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.attributes import detection_times
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, UNKNOWN, Detections, Scan

NS = 10**9
START_NS = 1_700_000_000 * NS
TOWER = {**tower.PARAMETERS, "lag": 1, "tower.fields.code": "code", "tower.fields.time": "time"}


def detections(**columns):
    size = max(len(column) for column in columns.values())
    return Detections(np.zeros((size, 2)), None, **columns)


def test_a_plot_is_of_the_sensors_that_its_kind_names():
    found = detection_times.sensors_of(detections(sensor_type=np.arange(1, 8)))
    named = [
        {name for name, of in zip(("psr", "ssr", "mds"), row, strict=True) if of} for row in found
    ]
    assert named == [
        {"psr"},
        {"ssr"},
        {"psr", "ssr"},
        {"mds"},
        {"mds"},
        {"psr", "mds"},
        {"psr", "mds"},
    ]


def test_without_a_kind_a_plot_is_of_what_its_identity_needs():
    given = detections(code=np.array([UNKNOWN, 0, 5]), address=np.array([UNKNOWN, UNKNOWN, 7]))
    assert np.argmax(detection_times.sensors_of(given), axis=1).tolist() == [0, 1, 2]
    assert detection_times.sensors_of(given).sum(axis=1).tolist() == [1, 1, 1]
    said = detections(code=np.array([0, 0]), sensor_type=np.array([UNKNOWN, 1]))
    assert detection_times.sensors_of(said).tolist() == [[False, True, False], [True, False, False]]


def test_only_a_plot_that_is_probably_the_targets_updates_it():
    given = detections(sensor_type=np.array([3, 1]), time_s=np.array([-1.5, -0.5]))
    after = detection_times.update(
        detection_times.never(2),
        np.array([0, 0, 1]),
        np.array([0, 1, 1]),
        np.array([0.7, 0.2, 0.45]),
        given,
        10 * NS,
    )
    assert after.tolist() == [[8.5 * NS, 8.5 * NS, UNKNOWN], [UNKNOWN] * 3]
    # A second radar's older plot does not make it older.
    older = detections(sensor_type=np.array([1]), time_s=np.array([-3.0]))
    again = detection_times.update(
        after, np.zeros(1, int), np.zeros(1, int), np.ones(1), older, 10 * NS
    )
    assert again.tolist() == after.tolist()


def run(parameters, kinds):
    """Return the filtered and smoothed estimates of one aircraft; a kind for each scan, or none."""
    engine, found = new_engine(resolve(parameters)), {FILTERED: [], SMOOTHED: []}
    for number, kind in enumerate(kinds):
        place = np.array([20e3 - 800.0 * number, 5e3])
        seen = np.array([[np.hypot(*place), np.arctan2(*place[::-1])]])
        given = Detections(
            seen,
            None,
            np.array([-0.25]),
            code=np.array([0o4521]) if kind in (2, 3) else np.array([UNKNOWN]),
            sensor_type=np.array([kind]) if parameters["tower.fields.kind"] else None,
        )
        if not kind:
            given = given.take(np.zeros(0, dtype=int))
        step = engine.step(Scan(START_NS + round(number * PERIOD_S * NS), (given,)))
        found[FILTERED] += step.filtered
        found[SMOOTHED] += step.smoothed
    return found


def test_estimates_have_the_times_of_sensors_and_are_the_same_but_for_them():
    found = run({**TOWER, "tower.fields.kind": "kind"}, [3, 3, 3, 3, 1, 1, 0])
    last = found[FILTERED][-1]
    ages = (last.stamp_ns - last.attributes.seen_ns) / NS
    # Nothing saw it in the last scan; the last answer was in the third one before that.
    assert ages[0, :2] == pytest.approx([PERIOD_S + 0.25, 3 * PERIOD_S + 0.25])
    assert last.attributes.seen_ns[0, 2] == UNKNOWN
    assert all(own.attributes.seen_ns is None for own in found[SMOOTHED])
    kinds = [3, 3, 3, 1, 3, 3]
    with_times = run({**TOWER, "tower.fields.kind": "kind"}, kinds)[FILTERED]
    without = run({**TOWER, "tower.fields.kind": ""}, kinds)[FILTERED]
    for one, other in zip(with_times, without, strict=True):
        np.testing.assert_array_equal(one.state, other.state)
        assert other.attributes.seen_ns is None
