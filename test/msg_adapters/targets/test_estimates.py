from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from samples import STAMP_NS, estimates, nothing
from sensor_msgs.msg import PointField

from msg_adapters.encoding import RejectedMessageError, cdr, stamps
from msg_adapters.targets import estimates as adapter
from msg_adapters.targets import markers, vertical
from phd_jdtc_ros.core.state_space import PLANAR, SPATIAL
from phd_jdtc_ros.core.types import COASTING, CONFIRMED, TENTATIVE, UNKNOWN, Attributes

F4, U4 = PointField.FLOAT32, PointField.UINT32
ARRAYS = (
    *("state", "covariance", "weight", "class_probability"),
    *("class_id", "track_id", "track_state"),
)


COVARIANCE = [f"cov_{row}{column}" for row in range(5) for column in range(row, 5)]


def column(message, name):
    (field,) = (field for field in message.fields if field.name == name)
    code = "<f4" if field.datatype == F4 else "<u4"
    points = np.frombuffer(bytes(message.data), dtype=np.uint8).reshape(-1, message.point_step)
    return points[:, field.offset : field.offset + 4].copy().view(code).ravel()


@pytest.mark.parametrize("classes", [1, 2, 3])
def test_estimates_survive_the_message_with_the_contract_of_the_topic(classes):
    message = adapter.to_msg(estimates(classes=classes), "map")
    expected = [
        *((name, F4) for name in ["x", "y", "z", "vx", "vy", "vz", "omega", "weight"]),
        *((name, U4) for name in ["track_id", "class_id", "lag"]),
        *((f"p_class_{index}", F4) for index in range(classes)),
        *((name, F4) for name in COVARIANCE),
        ("state", U4),
    ]
    assert [(f.name, f.datatype) for f in message.fields] == expected
    assert message.header == stamps.header(STAMP_NS, "map")
    given = estimates(classes=classes)
    found = adapter.from_msg(adapter.to_msg(given, "map"))
    assert (found.stamp_ns, found.lag) == (given.stamp_ns, given.lag)
    assert found.attributes is None
    for name in ARRAYS:
        assert_array_equal(getattr(found, name), getattr(given, name), err_msg=name)


def test_to_msg_takes_the_state_apart_as_x_vx_y_vy_omega():
    given = estimates()
    message = adapter.to_msg(given, "map")
    for index, name in enumerate(["x", "vx", "y", "vy", "omega"]):
        assert_array_equal(column(message, name), given.state[:, index])
    for name in ("z", "vz"):
        assert_array_equal(column(message, name), np.zeros(3))
    assert_array_equal(column(message, "lag"), [5, 5, 5])
    assert_array_equal(column(message, "cov_03"), given.covariance[:, 0, 3])
    assert_array_equal(column(message, "cov_24"), given.covariance[:, 2, 4])


def test_state_of_a_track_is_the_last_field_or_confirmed():
    given = replace(estimates(), track_state=np.array([TENTATIVE, CONFIRMED, COASTING]))
    message = adapter.to_msg(given, "map")
    assert message.fields[-1].name == "state"
    assert_array_equal(column(message, "state"), [0, 1, 2])
    assert_array_equal(adapter.from_msg(message).track_state, given.track_state)
    message = adapter.to_msg(estimates(), "map")
    message.fields = message.fields[:-1]
    assert_array_equal(adapter.from_msg(message).track_state, [CONFIRMED] * 3)


def with_attributes(classes=2):
    """Return estimates of which the first target's height and identities are known."""
    sample = estimates(classes)
    count = len(sample)
    height, covariance = np.full((count, 2), np.nan), np.full((count, 2, 2), np.nan)
    height[0], covariance[0] = [3048.0, -7.5], [[60.0, 2.0], [2.0, 1.5]]
    code, address = np.full(count, UNKNOWN), np.full(count, UNKNOWN)
    code[0], address[0] = 0o7700, 0x3C6444
    return replace(sample, attributes=Attributes(height, covariance, code, address))


def test_heights_and_identities_are_the_last_fields_and_survive_the_message():
    sample = with_attributes()
    message = adapter.to_msg(sample, "map")
    names = [field.name for field in message.fields]
    assert names[-6:] == ["state", "cov_zz", "cov_zvz", "cov_vzvz", "code", "address"]
    assert column(message, "z")[0] == 3048.0
    assert column(message, "code")[1] == 2**32 - 1
    found = adapter.from_msg(message).attributes
    for name in ("height", "height_covariance", "code", "address"):
        assert_array_equal(getattr(found, name), getattr(sample.attributes, name))


def test_times_since_sensors_saw_targets_survive_the_message():
    sample = with_attributes()
    seen_ns = np.full((len(sample), 3), UNKNOWN)
    seen_ns[0, :2] = sample.stamp_ns - np.array([1_250_000_000, 8_500_000_000])
    known = replace(sample.attributes, seen_ns=seen_ns)
    message = adapter.to_msg(replace(sample, attributes=known), "map")
    ages = ["age_psr", "age_ssr", "age_mds"]
    assert [field.name for field in message.fields][-3:] == ages
    assert [column(message, name)[0] for name in ages[:2]] == [1.25, 8.5]
    assert np.isnan(column(message, "age_mds")).all()
    assert_array_equal(adapter.from_msg(message).attributes.seen_ns, seen_ns)
    # Without times there are no such fields.
    plain = adapter.from_msg(adapter.to_msg(sample, "map"))
    assert plain.attributes.seen_ns is None


def test_from_msg_rejects_impossible_states_and_classes():
    message = adapter.to_msg(replace(estimates(), track_state=np.array([0, 1, 3])), "map")
    with pytest.raises(RejectedMessageError, match="state is 3, must be at most 2"):
        adapter.from_msg(message)
    given = estimates(classes=3)
    there = adapter.to_msg(replace(given, class_id=np.array([0, 1, 2])), "map")
    assert_array_equal(adapter.from_msg(there).class_id, [0, 1, 2])
    message = adapter.to_msg(replace(given, class_id=np.array([0, 10**6, 2])), "map")
    with pytest.raises(RejectedMessageError, match="class_id is 1000000, must be below 3"):
        adapter.from_msg(message)


@pytest.mark.parametrize(("name", "bad"), [("x", np.nan), ("y", np.inf), ("cov_00", np.nan)])
def test_from_msg_refuses_what_is_not_finite(name, bad):
    message = adapter.to_msg(estimates(), "map")
    (field,) = (field for field in message.fields if field.name == name)
    data = bytearray(message.data)
    data[field.offset : field.offset + 4] = np.float32(bad).tobytes()
    message.data = bytes(data)
    with pytest.raises(RejectedMessageError):
        adapter.from_msg(message)


@pytest.mark.parametrize("given", [estimates(), nothing()], ids=["some", "none"])
def test_to_cdr_is_the_serialised_message(given):
    assert adapter.to_cdr(given, "map") == cdr.encode(adapter.to_msg(given, "map"))


def known(height, code, address):
    """Return two estimates, the first with these attributes and the second with none."""
    sample = estimates(2)
    count = len(sample)
    heights = np.full((count, 2), np.nan)
    heights[0] = height, 0.0
    codes, addresses = np.full(count, UNKNOWN), np.full(count, UNKNOWN)
    codes[0], addresses[0] = code, address
    spread = np.where(np.isnan(heights)[:, :, None], np.nan, np.eye(2))
    return replace(sample, attributes=Attributes(heights, spread, codes, addresses))


def test_words_are_flight_level_and_identity():
    assert vertical.words(known(3048.0, 0o7700, 0x3C6444))[:2] == ["FL100 7700", ""]
    assert vertical.words(known(3048.0, UNKNOWN, 0x3C6444))[0] == "FL100 3C6444"
    assert vertical.words(known(3048.0, UNKNOWN, UNKNOWN), 304.8)[0] == "FL110"
    assert vertical.words(known(-304.8, 0, UNKNOWN))[0] == "FL-010 0000"
    assert vertical.words(known(np.nan, 0o0021, UNKNOWN))[0] == "0021"
    assert vertical.words(estimates(2)) == [""] * len(estimates(2))
    found = known(3048.0, 0o7700, UNKNOWN)
    assert vertical.words(found, 152.4)[0] == "FL105 7700"
    assert b" FL105 7700" in markers.to_cdr(found, "map", ("one", "two"), 152.4)
    found = vertical.of(known(3048.0, UNKNOWN, UNKNOWN))
    assert found.known.tolist()[:2] == [True, False]
    assert found.state[:2].tolist() == [[3048.0, 0.0], [0.0, 0.0]]
    assert not found.covariance[1].any()
    assert not vertical.of(estimates(2)).known.any()


CROSS = [f"cov_{row}{column}" for row in PLANAR.axes for column in ("z", "vz")]


def in_space():
    """Return estimates in space, of which the second has no known height."""
    rng = np.random.default_rng(3)
    half = rng.integers(-8, 8, (3, 7, 7)).astype(float)
    covariance = half @ half.transpose(0, 2, 1) + 16.0 * np.eye(7)
    covariance[1, 5, 5] = 1e6
    planar = estimates()
    found = planar.changed(
        state=np.concatenate([planar.state, rng.integers(-99, 99, (3, 2)) * 0.5], axis=1),
        covariance=covariance,
        space=SPATIAL,
    )
    return found.with_heights(500.0)


def test_estimates_in_space_keep_the_layout_and_end_with_the_covariances_of_heights():
    given = in_space()
    message = adapter.to_msg(given, "map")
    names = [field.name for field in message.fields]
    before = [field.name for field in adapter.to_msg(estimates(), "map").fields]
    assert names[: len(before)] == before
    own = ["cov_zz", "cov_zvz", "cov_vzvz", "code", "address", *CROSS, "pressure_altitude"]
    assert names[len(before) :] == own
    known = [0, 2]
    for name, axis in (("z", 5), ("vz", 6)):
        assert_array_equal(column(message, name)[known], given.state[known, axis])
        assert column(message, name)[1] == 0.0
    for name, (row, other) in {"cov_zz": (5, 5), "cov_yvz": (2, 6), "cov_omegaz": (4, 5)}.items():
        assert_array_equal(column(message, name)[known], given.covariance[known, row, other])
        assert np.isnan(column(message, name)[1])
    assert_array_equal(column(message, "cov_24"), given.covariance[:, 2, 4])


def test_estimates_in_space_survive_the_message():
    given = in_space()
    found = adapter.from_msg(adapter.to_msg(given, "map"))
    assert found.space == SPATIAL
    known = [0, 2]
    for name in ("state", "covariance"):
        assert_array_equal(getattr(found, name)[known], getattr(given, name)[known])
    # What is not known has neither a height nor a covariance with it.
    assert not found.state[1, 5:].any()
    assert not found.covariance[1, 5:].any()
    assert_array_equal(found.attributes.height, given.attributes.height)
    assert_array_equal(found.covariance_in_space, given.covariance_in_space)


def test_pressure_altitudes_are_beside_heights_where_they_are_known():
    given = in_space().with_pressure(-40.0, 10.0).with_heights(500.0)
    message = adapter.to_msg(given, "map")
    shown = column(message, "pressure_altitude")
    assert_array_equal(shown[[0, 2]], given.state[[0, 2], 5] - 40.0)
    assert np.isnan(shown[1])
    assert adapter.from_msg(message).pressure_above == -40.0
    unknown = adapter.to_msg(in_space(), "map")
    assert np.isnan(column(unknown, "pressure_altitude")).all()
    assert np.isnan(adapter.from_msg(unknown).pressure_above)


def test_covariance_in_space_has_axes_x_y_z_and_their_velocities():
    given = in_space()
    axes = [0, 2, 5, 1, 3, 6]
    assert_array_equal(given.covariance_in_space[0], given.covariance[0][np.ix_(axes, axes)])
    unknown = np.isnan(given.covariance_in_space[1])
    assert unknown[2].all()
    assert not unknown[np.ix_([0, 1, 3, 4], [0, 1, 3, 4])].any()
    assert np.isnan(estimates().covariance_in_space[:, 2]).all()
