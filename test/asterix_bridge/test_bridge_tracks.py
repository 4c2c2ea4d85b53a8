import math
from dataclasses import replace

import numpy as np
import pytest
from asterix_reference import decoded, value
from scipy.integrate import trapezoid

from msg_adapters.encoding import RejectedMessageError, point_cloud
from msg_adapters.targets import estimates
from phd_jdtc_ros.asterix.messages import NONE, CallSigns
from phd_jdtc_ros.asterix.writing import Source
from phd_jdtc_ros.asterix_bridge.tracks import TrackOutput
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.core.types import Estimates
from phd_jdtc_ros.earth import SystemPlane

NS = 10**9
T0 = 20_779 * 86_400 * NS
ORIGIN = [52.0, 4.5, 0.0]


def cloud(rows, stamp_ns=T0, heights=False, ages=False, wide=()):
    """Return a cloud of estimates; rows are mappings of fields, the others are zero."""
    names = ["x", "y", "z", "vx", "vy", "vz", "omega", "weight", "track_id", "state"]
    names += ["class_id", "lag", "p_class_0"]
    names += [f"cov_{row}{column}" for row in range(5) for column in range(row, 5)]
    if heights:
        names += ["cov_zz", "cov_zvz", "cov_vzvz", "code", "address"]
    if ages:
        names += ["age_psr", "age_ssr", "age_mds"]
    unsigned = {"track_id", "state", "code", "address", "class_id", "lag"}
    defaults = {"track_id": 1, "state": 1, "code": 2**32 - 1, "address": 2**32 - 1}
    columns = {
        name: np.array(
            [row.get(name, defaults.get(name, 0.0)) for row in rows],
            dtype=np.uint32 if name in unsigned else np.float64,
        )
        for name in names
    }
    return point_cloud.encode(stamp_ns, "map", columns, wide)


def output(plane=None, max_prediction_s=10.0):
    return TrackOutput(Source(1, 2), plane, max_prediction_s, CallSigns())


def test_tracks_and_heights_are_predicted_to_the_output_and_not_for_long():
    made = output()
    made.update(cloud([{"x": 1000.0, "y": -500.0, "vx": 100.0, "vy": -50.0}]))
    (track,) = made.reports(T0 + 2 * NS)
    assert track.position == pytest.approx((1200.0, -600.0))
    assert track.velocity == pytest.approx((100.0, -50.0))
    made = output()
    made.update(cloud([{"cov_zz": 900.0, "cov_zvz": -10.0, "cov_vzvz": 4.0}], heights=True))
    (track,) = made.reports(T0 + 5 * NS)
    assert track.height_std**2 == pytest.approx(900.0 - 100.0 + 100.0)
    assert track.climb_std == pytest.approx(2.0)
    made = output(max_prediction_s=5.0)
    made.update(cloud([{"track_id": 9}]))
    assert [track.last for track in made.reports(T0 + 5 * NS)] == [False]
    assert [track.last for track in made.reports(T0 + 6 * NS)] == [True]
    assert made.reports(T0 + 7 * NS) == []


@pytest.mark.parametrize("omega", [0.05, -0.08])
def test_turning_tracks_are_predicted_along_their_circle(omega):
    made = output()
    made.update(cloud([{"vx": 200.0, "vy": 0.0, "omega": omega}]))
    (track,) = made.reports(T0 + 4 * NS)
    angle, radius = 4.0 * omega, 200.0 / omega
    assert track.position == pytest.approx(
        (radius * math.sin(angle), radius * (1.0 - math.cos(angle))), rel=1e-5
    )
    assert track.velocity == pytest.approx((200.0 * math.cos(angle), 200.0 * math.sin(angle)))
    assert track.course == (2 if omega > 0.0 else 1)


@pytest.mark.parametrize("omega", [0.0, 0.05])
def test_deviations_are_predicted_with_the_position(omega):
    made = output()
    given = {"vx": 200.0, "omega": omega}
    given |= {"cov_00": 900.0, "cov_01": 60.0, "cov_11": 100.0, "cov_22": 400.0, "cov_33": 25.0}
    made.update(cloud([{**given, "cov_44": 1e-4}]))
    (track,) = made.reports(T0 + 4 * NS)
    covariance = np.diag([900.0, 100.0, 400.0, 25.0, 1e-4])
    covariance[0, 1] = covariance[1, 0] = 60.0

    def moved(vx, vy, rate):
        # The integral of a velocity that turns, over four seconds.
        times = np.linspace(0.0, 4.0, 4001)
        along, across = np.cos(rate * times), np.sin(rate * times)
        velocity = np.stack([along * vx - across * vy, across * vx + along * vy])
        return trapezoid(velocity, times)

    step = np.array([1e-3, 1e-3, 1e-6])
    centre = np.array([200.0, 0.0, omega])
    slopes = [
        (moved(*(centre + h)) - moved(*(centre - h))) / (2.0 * h.sum()) for h in np.diag(step)
    ]
    jacobian = np.zeros((2, 5))
    jacobian[0, 0] = jacobian[1, 2] = 1.0
    jacobian[:, [1, 3, 4]] = np.transpose(slopes)
    expected = jacobian @ covariance @ jacobian.T
    assert track.position_std == pytest.approx(np.sqrt(np.diag(expected)), rel=1e-4)
    assert track.covariance == pytest.approx(expected[0, 1], rel=1e-3, abs=1e-3)
    assert track.position_std[0] > 30.0


def test_deviations_have_the_noise_of_the_trackers_modes():
    given = {"cov_00": 900.0, "cov_22": 400.0, "cov_44": 1e-6, "p_class_0": 1.0}
    modes = resolve({"classes": ["one"]}).model.modes
    made, without, foreign = output(), output(), output()
    made.modes, foreign.modes = modes, resolve({}).model.modes  # There are two classes
    for each in (made, without, foreign):
        each.update(cloud([given]))
    before, after = without.reports(T0 + 6 * NS)[0], made.reports(T0 + 6 * NS)[0]
    density = sum(modes.motion_share * [motion.noise_density for motion in modes.motions])
    grown = np.square(after.position_std) - np.square(before.position_std)
    assert grown == pytest.approx(density * 6.0**3 / 3.0)
    assert np.square(after.velocity_std) == pytest.approx(density * 6.0)
    assert foreign.reports(T0 + 6 * NS)[0].position_std == before.position_std
    # A stamp a little ahead of the clock adds noise too.
    assert made.reports(T0 - NS)[0].position_std[0] > 30.0
    assert made.reports(T0)[0].position_std == (30.0, 20.0)


def test_trackers_that_have_a_track_are_those_of_a_joint_cloud():
    found = estimates.from_msg(cloud([{"track_id": 1}, {"track_id": 2}]))
    members = np.array([[1, 12, 2**32 + 7, 0], [2, 0, 0, 5]])
    made = output()
    made.update(estimates.to_msg(replace(found, members=members), "map"))
    assert [track.composed for track in made.reports(T0)] == [((2, 7), (1, 12)), ((3, 5),)]
    wrong = replace(found, members=np.array([[3, 1, 1, 1], [0, 1, 1, 1]]))
    with pytest.raises(RejectedMessageError, match="owner is 3, must be below 3"):
        made.update(estimates.to_msg(wrong, "map"))


def test_course_is_straight_or_unknown_where_it_does_not_turn_for_sure():
    made = output()
    made.update(
        cloud(
            [
                {"track_id": 1, "omega": 0.001},
                {"track_id": 2, "omega": 0.05, "cov_44": 0.05**2},
                {"track_id": 3, "omega": 0.05, "cov_44": 0.01**2},
            ]
        )
    )
    assert [track.course for track in made.reports(T0)] == [0, 3, 2]


def test_places_on_earth_are_those_of_the_system_plane():
    made = output(SystemPlane(ORIGIN))
    made.update(cloud([{"x": 50e3, "y": 30e3}, {"track_id": 2}]))
    (track, at_origin) = made.reports(T0)
    x, y = SystemPlane(ORIGIN).to_plane(*track.geodetic)
    assert (float(x), float(y)) == pytest.approx((50e3, 30e3), abs=1e-6)
    assert at_origin.geodetic == pytest.approx((52.0, 4.5))
    records = decoded(b"".join(made.datagrams(T0)))
    assert value(records[1], "I105", "Lat") == pytest.approx(52.0, abs=90 / 2**25)


def test_heights_codes_and_addresses_are_those_of_the_estimates():
    known = {"z": 3048.0, "vz": -5.0, "cov_zz": 900.0, "cov_vzvz": 4.0, "code": 4032, "address": 7}
    made = output()
    made.update(cloud([known, {"track_id": 2, "cov_zz": math.nan}], heights=True))
    first, second = made.reports(T0 + 2 * NS)
    assert (first.height, first.climb) == pytest.approx((3038.0, -5.0))
    predicted_std = math.sqrt(900.0 + 4.0 * 2.0**2)
    assert (first.height_std, first.climb_std) == pytest.approx((predicted_std, 2.0))
    assert (first.code, first.address, first.vertical) == (4032, 7, 2)
    assert math.isnan(second.height)
    assert (second.code, second.address, second.vertical) == (-1, -1, 3)


def test_heights_of_targets_in_space_are_geometric_beside_their_flight_levels():
    state = np.zeros((2, 7))
    state[0], state[1, 2] = [1e3, 50.0, 2e3, 0.0, 0.0, 3048.0, 4.0], 9e3
    covariance = np.tile(np.diag([100.0, 4.0, 100.0, 4.0, 1e-4, 400.0, 1.0]), (2, 1, 1))
    covariance[1, 5, 5] = 1e8
    found = Estimates.empty(T0, 0, 1, SPATIAL).changed(
        state=state,
        covariance=covariance,
        weight=np.ones(2),
        class_probability=np.ones((2, 1)),
        class_id=np.zeros(2, dtype=np.int64),
        track_id=np.array([1, 2]),
        track_state=np.ones(2, dtype=np.int64),
    )
    made = output()
    made.update(estimates.to_msg(found.with_pressure(-76.2, 5.0).with_heights(1e3), "map"))
    known, unknown = made.reports(T0 + 2 * NS)
    assert known.position == pytest.approx((1100.0, 2000.0))
    assert known.height == pytest.approx(3056.0)
    assert known.geometric
    (record, other, *_) = decoded(b"".join(made.datagrams(T0 + 2 * NS)))
    assert 0.3048 * value(record, "I130", "Alt") == pytest.approx(3056.0, abs=1.0)
    # The flight level is that of the pressure altitude.
    assert 0.3048 * value(record, "I136", "MFL") == pytest.approx(3056.0 - 76.2, abs=3.9)
    assert "I135" in record
    assert math.isnan(unknown.height)
    assert not {"I130", "I135", "I136"} & other.keys()


def test_heights_are_counted_from_the_origin_where_known():
    made = output(SystemPlane([52.0, 4.5, 250.0]))
    made.update(cloud([{"z": 3048.0, "cov_zz": 900.0}], heights=True))
    (record, *_) = decoded(b"".join(made.datagrams(T0)))
    assert 0.3048 * value(record, "I136", "MFL") == pytest.approx(3048.0 + 250.0, abs=3.9)
    made = output()
    made.update(cloud([{"z": 0.0, "vz": 0.0}]))
    (track,) = made.reports(T0)
    assert math.isnan(track.height)
    assert track.vertical == 3


def test_tentative_coasting_first_and_last_are_flagged():
    made = output()
    made.update(cloud([{"track_id": 1, "state": 0}, {"track_id": 2, "state": 1}]))
    tentative, confirmed = made.reports(T0)
    assert (tentative.confirmed, confirmed.confirmed) == (False, True)
    assert tentative.first
    assert confirmed.first
    made.update(cloud([{"track_id": 2, "state": 2}], T0 + 4 * NS))
    coasting, ended = made.reports(T0 + 5 * NS)
    assert (coasting.number, coasting.coasting, coasting.first) == (2, True, False)
    assert (coasting.age_s, coasting.since_s) == (5.0, 5.0)
    assert (ended.number, ended.last) == (1, True)
    assert [track.last for track in made.reports(T0 + 6 * NS)] == [False]


def test_numbers_of_a_new_run_are_of_new_tracks():
    made = output()
    made.update(cloud([{"track_id": 1}, {"track_id": 2}], T0 + 100 * NS))
    made.reports(T0 + 100 * NS)
    made.update(cloud([{"track_id": 1}]))
    again, ended = made.reports(T0 + 2 * NS)
    assert (again.number, again.first, again.age_s, again.since_s) == (1, True, 2.0, 2.0)
    assert (ended.number, ended.last) == (2, True)


def test_ages_of_sensors_grow_until_the_output_and_those_of_none_are_left_out():
    made = output()
    row = {"code": 4032, "age_psr": 0.5, "age_ssr": 8.5, "age_mds": math.nan}
    made.update(cloud([row], heights=True, ages=True))
    assert made.reports(T0 + 2 * NS)[0].sensor_ages_s[:2] == (2.5, 10.5)
    record, *_ = decoded(b"".join(made.datagrams(T0 + 2 * NS)))
    assert record["I290"].keys() == {"TRK", "PSR", "SSR"}
    assert value(record, "I290", "PSR", "PSR") == 2.5
    assert value(record, "I290", "SSR", "SSR") == 10.5


def test_unlabelled_estimates_are_no_tracks_and_large_numbers_fit():
    made = output()
    made.update(
        cloud([{"track_id": 0}, {"track_id": 65_535}, {"track_id": 65_536}, {"track_id": 7}])
    )
    assert [track.number for track in made.reports(T0)] == [65_535, 1, 7]


def test_every_output_ends_with_the_state_of_the_tracker():
    made = output()
    kinds = [[record["category"] for record in decoded(b"".join(made.datagrams(T0)))]]
    made.update(cloud([{"track_id": 1}, {"track_id": 2}]))
    kinds.append([record["category"] for record in decoded(b"".join(made.datagrams(T0)))])
    assert kinds == [[65, 65], [62, 62, 65, 65]]
    assert (made.batch, made.tracks) == (2, 2)


def test_cloud_that_has_no_estimates_is_refused_and_changes_nothing():
    made = output()
    made.update(cloud([{"track_id": 5}]))
    with pytest.raises(RejectedMessageError):
        made.update(point_cloud.encode(T0, "map", {"x": np.zeros(1)}))
    with pytest.raises(RejectedMessageError):
        made.update(cloud([{"x": math.nan}]))
    assert [track.number for track in made.reports(T0)] == [5]


@pytest.mark.parametrize(
    ("field", "value"), [("x", 1.7e308), ("vx", 1e300), ("cov_00", 1e300), ("omega", -1e300)]
)
def test_a_cloud_with_absurd_numbers_is_refused(field, value):
    with pytest.raises(RejectedMessageError, match=f"'{field}' has a value that is not finite"):
        output().update(cloud([{field: value}], wide={field}))


@pytest.mark.parametrize("field", ["z", "vz", "cov_zz", "cov_vzvz"])
def test_an_absurd_height_is_unknown(field):
    made = output()
    made.update(cloud([{"cov_zz": 1.0, "cov_vzvz": 1.0, field: 1e300}], heights=True, wide={field}))
    (track,) = made.reports(T0)
    assert math.isnan(track.height)


@pytest.mark.parametrize("field", ["code", "address"])
def test_an_identity_that_is_none_is_unknown(field):
    made = output()
    made.update(cloud([{field: 2**31 - 1}], heights=True))
    (track,) = made.reports(T0)
    assert getattr(track, field) == NONE


def test_what_cannot_be_sent_is_refused():
    with pytest.raises(RejectedMessageError, match="at most 10000 are allowed"):
        output().update(cloud([{}] * 10_001))
    made = cloud([{}])
    made.header.stamp.nanosec = 2**32 - 1
    with pytest.raises(RejectedMessageError, match="must be from 0 s"):
        output().update(made)
