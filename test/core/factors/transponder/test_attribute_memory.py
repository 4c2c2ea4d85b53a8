"""Identities: two aircraft that cross, and when each kind of sensor saw them."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import tower
from lone import lone, scan_at
from reference import resolve
from runs import equal, reprocessed_from, restored_after, stepped, stored_and_read
from tower import PERIOD_S

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.factors.transponder import detection_times
from phd_jdtc_ros.core.models.detection_clusters import merge_clusters
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, UNKNOWN, Detections, Scan

SCANS, PERIOD = 24, 4.0
CODES, ADDRESSES = np.array([0o1234, 0o4567]), np.array([0x3C6444, 0x4CA123])
GIVEN = {
    "interval_s": PERIOD,
    "births": [],
    "detection_births.rates": [0.05],
    "detection_births.std": [100.0, 2e-3],
    "lag": 3,
    "radar.position": [0.0, 0.0],
    "radar.yaw_deg": 0.0,
    "radar.range_std": 60.0,
    "radar.azimuth_std_deg": 0.3,
    "radar.detection_probability": 0.95,
    "radar.clutter_rate": 2.0,
    "radar.clutter_max_range": 5e4,
    "cv.noise_density": 3.0,
}
FIELDS = {"radar.fields.code": "code", "radar.fields.address": "address"}
NS = 10**9
START_NS = 1_700_000_000 * NS
TOWER = {**tower.PARAMETERS, "lag": 1, "tower.fields.code": "code", "tower.fields.time": "time"}


def truth(time_s):
    """Return the positions of both: they cross at 48 s at a small angle."""
    along, side = 2e4 + 120.0 * time_s, 12.0 * (time_s - 48.0)
    return np.array([[along, side], [along, -side]])


def scans(seed=9000, columns=("code", "address"), codes=CODES, addresses=ADDRESSES):
    """Return scans of both targets, each with its transponder's reply."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(SCANS):
        position = truth(number * PERIOD)
        exact = np.stack([np.hypot(*position.T), np.arctan2(position[:, 1], position[:, 0])], 1)
        noisy = exact + rng.standard_normal((2, 2)) * [60.0, np.radians(0.3)]
        order = rng.permutation(2)
        own = {"code": codes, "address": addresses}
        more = {name: own[name][order] for name in columns}
        found.append(scan_at(number * PERIOD + PERIOD, noisy[order], **more))
    return found


def tracker_of(given=None):
    return new_engine(lone({**GIVEN, **FIELDS, **(given or {})}))


def run(given=None, steps=None):
    """Return the filtered and smoothed estimates of an engine, and the engine."""
    tracker = tracker_of(given)
    return *stepped(tracker, scans() if steps is None else steps), tracker


def test_tracks_that_cross_keep_their_identities():
    filtered, smoothed, _ = run()
    for estimates in (*filtered[6:], *smoothed[4:]):
        assert sorted(estimates.attributes.code.tolist()) == sorted(CODES.tolist())
        seconds = (estimates.stamp_ns - filtered[0].stamp_ns) * 1e-9
        place = dict(zip(CODES.tolist(), truth(seconds), strict=True))
        apart = estimates.position - [place[code] for code in estimates.attributes.code.tolist()]
        assert np.hypot(*apart.T).max() < 400.0
    first, last = filtered[8], filtered[-1]
    numbers = [
        dict(zip(e.attributes.code.tolist(), e.track_id.tolist(), strict=True))
        for e in (first, last)
    ]
    assert numbers[0] == numbers[1]
    assert set(numbers[0]) == set(CODES.tolist())
    assert sorted(last.attributes.address.tolist()) == sorted(ADDRESSES.tolist())


def test_swapped_fields_show_no_identity_of_the_wrong_kind():
    # Addresses do not fit a code's field; whoever reads messages drops them, see `identities`.
    steps = scans(codes=np.array([UNKNOWN, UNKNOWN]), addresses=CODES)
    filtered, _, _ = run(steps=steps)
    assert (filtered[-1].attributes.code == UNKNOWN).all()
    assert sorted(filtered[-1].attributes.address.tolist()) == sorted(CODES.tolist())


@pytest.mark.parametrize("code", [0, 0o7777])
def test_code_that_all_share_is_reported_and_tracks_stay_two(code):
    steps = scans(columns=("code",), codes=np.array([code, code]))
    filtered, _, _ = run(steps=steps)
    assert filtered[-1].attributes.code.tolist() == [code, code]
    assert (filtered[-1].attributes.address == UNKNOWN).all()


def test_estimates_without_fields_are_the_same_bit_by_bit():
    none = {"radar.fields.code": "", "radar.fields.address": ""}
    plain, plain_smoothed, tracker = run(none, scans(columns=()))
    ignored, ignored_smoothed, _ = run(none)
    # The fields are configured, but the radar's clouds have none.
    lacking, lacking_smoothed, _ = run(steps=scans(columns=()))
    assert not tracker.snapshot().names_below("attributes")
    assert equal(plain, ignored)
    assert equal(plain, lacking)
    assert equal(plain_smoothed, ignored_smoothed)
    assert equal(plain_smoothed, lacking_smoothed)
    assert {found.attributes for found in (*plain, *ignored)} == {None}
    assert all((found.attributes.code == UNKNOWN).all() for found in lacking)


def same(a, b):
    names = ("height", "height_covariance", "code", "address")
    return equal(a, b) and all(
        np.array_equal(getattr(x.attributes, name), getattr(y.attributes, name), equal_nan=True)
        for x, y in zip(a, b, strict=True)
        for name in names
    )


def with_heights(steps):
    return [
        replace(scan, detections=(replace(scan.detections[0], height=np.array([914.4, 3048.0])),))
        for scan in steps
    ]


def test_restored_engine_goes_on_with_what_it_knew():
    new = partial(tracker_of, {"radar.fields.height": "height"})
    first, second = restored_after([10], new, with_heights(scans()), same)
    assert same(first.flush(), second.flush())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("record.code", 4096),
        ("record.address", -2),
        ("record.code_weight", 0.7),
        ("record.code_weight", np.nan),
        ("record.origin", -1),
        ("record.stamp_ns", -5),
        ("record.height_known", 1.5),
        ("record.height", np.inf),
        ("history.mean", np.nan),
        ("history.covariance", -1.0),
        ("history.origin", 1 << 59),
    ],
)
def test_forged_snapshot_is_refused(name, value):
    given = {"radar.fields.height": "height"}
    _, _, tracker = run(given, with_heights(scans())[:4])
    forged = stored_and_read(tracker.snapshot())
    array = forged.arrays[f"attributes.{name}"].copy()
    array[0] = value
    forged.arrays[f"attributes.{name}"] = array
    with pytest.raises(ValueError, match="attributes"):
        tracker.restore(forged)


def test_memory_forgets_targets_that_are_gone():
    _, _, tracker = run()
    empty = scan_at(1000.0, np.zeros((0, 2)), code=np.zeros(0, int), address=np.zeros(0, int))
    for seconds in np.arange(104.0, 300.0, PERIOD):
        tracker.step(replace(empty, stamp_ns=10**12 + round(seconds * 1e9)))
    alive = np.concatenate([rows.row_label for rows in tracker.forward.unswept])
    assert set(tracker.forward.factors.transponders.records.label) <= set(alive.tolist())


def test_merged_detections_have_the_first_known_identity_and_the_mean_height():
    radar = replace(lone().model.radars[0], cluster_distance=50.0, range_std=1.0)
    detections = Detections(
        np.array([[5000.0, 0.1], [5001.0, 0.1], [9000.0, 1.0]]),
        None,
        height=np.array([1000.0, 1010.0, np.nan]),
        code=np.array([UNKNOWN, 5, UNKNOWN]),
        address=np.array([7, UNKNOWN, UNKNOWN]),
    )
    one = merge_clusters(detections, radar)
    assert one.code.tolist() == [5, UNKNOWN]
    assert one.address.tolist() == [7, UNKNOWN]
    np.testing.assert_array_equal(one.height, [1005.0, np.nan])


@pytest.mark.parametrize("code", ["7a00", "8000", "700", "70000"])
def test_shared_code_that_is_none_is_refused(code):
    with pytest.raises(ConfigError, match="four octal digits"):
        lone({"shared_codes": [code]})


def test_reprocessed_scans_leave_the_same_knowledge():
    new = partial(tracker_of, {"radar.fields.height": "height"})
    reprocessed_from(10, new, with_heights(scans())[:12])


def detections(**columns):
    size = max(len(column) for column in columns.values())
    return Detections(np.zeros((size, 2)), None, **columns)


def test_a_plot_is_of_the_sensors_that_its_kind_names():
    found = detection_times.sensors_of(detections(detection_type=np.arange(1, 8)))
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
    said = detections(code=np.array([0, 0]), detection_type=np.array([UNKNOWN, 1]))
    assert detection_times.sensors_of(said).tolist() == [[False, True, False], [True, False, False]]


def test_only_a_plot_that_is_probably_the_targets_updates_it():
    given = detections(detection_type=np.array([3, 1]), time_s=np.array([-1.5, -0.5]))
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
    older = detections(detection_type=np.array([1]), time_s=np.array([-3.0]))
    again = detection_times.update(
        after, np.zeros(1, int), np.zeros(1, int), np.ones(1), older, 10 * NS
    )
    assert again.tolist() == after.tolist()


def run_with_times(parameters, kinds):
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
            detection_type=np.array([kind]) if parameters["tower.fields.detection_type"] else None,
        )
        if not kind:
            given = given.take(np.zeros(0, dtype=int))
        step = engine.step(Scan(START_NS + round(number * PERIOD_S * NS), (given,)))
        found[FILTERED] += step.filtered
        found[SMOOTHED] += step.smoothed
    return found


def test_estimates_have_the_times_of_sensors_and_are_the_same_but_for_them():
    found = run_with_times({**TOWER, "tower.fields.detection_type": "kind"}, [3, 3, 3, 3, 1, 1, 0])
    last = found[FILTERED][-1]
    ages = (last.stamp_ns - last.attributes.seen_ns) / NS
    # Nothing saw it in the last scan; the last answer was in the third one before that.
    assert ages[0, :2] == pytest.approx([PERIOD_S + 0.25, 3 * PERIOD_S + 0.25])
    assert last.attributes.seen_ns[0, 2] == UNKNOWN
    assert all(own.attributes.seen_ns is None for own in found[SMOOTHED])
    kinds = [3, 3, 3, 1, 3, 3]
    with_times = run_with_times({**TOWER, "tower.fields.detection_type": "kind"}, kinds)[FILTERED]
    without = run_with_times({**TOWER, "tower.fields.detection_type": ""}, kinds)[FILTERED]
    for one, other in zip(with_times, without, strict=True):
        np.testing.assert_array_equal(one.state, other.state)
        assert other.attributes.seen_ns is None
