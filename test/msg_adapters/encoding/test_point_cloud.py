import numpy as np
import pytest
import samples
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from rclpy.serialization import deserialize_message
from samples import STAMP_NS, cloud
from sensor_msgs.msg import PointCloud2, PointField

from msg_adapters.encoding import RejectedMessageError, cdr, point_cloud, stamps
from msg_adapters.incoming import detections
from msg_adapters.targets import estimates, truth

F4, F8, U4 = PointField.FLOAT32, PointField.FLOAT64, PointField.UINT32
WANTED = {"a": point_cloud.FLOATS, "n": point_cloud.UNSIGNED}
ROWS = [(1.5, 7), (-2.25, 0), (3e5, 4_000_000_000), (0.0, 1)]
COLUMNS = {"a": [1.5, -2.25, 3e5, 0.0], "n": [7, 0, 4_000_000_000, 1]}


def good(**layout):
    return cloud([("a", F4), ("n", U4)], ROWS, **layout)


def assert_columns(found):
    assert list(found) == list(COLUMNS)
    for name, column in COLUMNS.items():
        assert_array_equal(found[name], column)
        assert found[name].dtype.isnative


def rejection(message, wanted=None):
    with pytest.raises(RejectedMessageError) as caught:
        point_cloud.decode(message, WANTED if wanted is None else wanted)
    assert "\n" not in str(caught.value)
    return caught.value.reason, str(caught.value)


def test_encode_survives_decode_without_points_too():
    columns = {"a": np.array([1.5, -2.25]), "n": np.array([7, 4_000_000_000])}
    found = point_cloud.decode(point_cloud.encode(STAMP_NS, "map", columns), WANTED)
    assert_array_equal(found["a"], columns["a"])
    assert_array_equal(found["n"], columns["n"])
    assert (found["a"].dtype, found["n"].dtype) == (np.float32, np.uint32)
    found = point_cloud.encode(STAMP_NS, "map", {"a": np.zeros(0), "n": np.zeros(0, dtype=int)})
    assert (found.height, found.width, found.point_step, found.row_step) == (1, 0, 8, 0)
    assert len(found.data) == 0
    decoded = point_cloud.decode(found, WANTED)
    assert [len(column) for column in decoded.values()] == [0, 0]


@pytest.mark.parametrize("count", [0, 1, 5])
# Frames and names of several lengths, so that members begin at every alignment.
@pytest.mark.parametrize("frame", ["", "a", "map", "site", "enu/origin"])
@pytest.mark.parametrize("name", ["n", "of", "ten", "four"])
def test_to_cdr_is_the_serialised_cloud_of_encode(count, frame, name):
    columns = {"a": np.arange(count) / 4.0, name: np.arange(count), "b": np.arange(count) * 1e9}
    arguments = STAMP_NS, frame, columns, {"b"}
    found = point_cloud.to_cdr(*arguments)
    assert deserialize_message(found, PointCloud2) == point_cloud.encode(*arguments)
    assert found == cdr.encode(point_cloud.encode(*arguments))


def test_encode_lays_out_points_little_endian_in_one_row():
    columns = {"a": np.array([1.0, -2.0]), "n": np.array([1, 258])}
    found = point_cloud.encode(STAMP_NS, "map", columns)
    assert bytes(found.data) == bytes.fromhex("0000803f 01000000 000000c0 02010000")
    assert not found.is_bigendian
    assert (found.height, found.width, found.point_step, found.row_step) == (1, 2, 8, 16)
    assert stamps.to_ns(found.header.stamp) == STAMP_NS
    assert found.header.frame_id == "map"
    assert [(f.name, f.offset, f.datatype, f.count) for f in found.fields] == [
        ("a", 0, F4, 1),
        ("n", 4, U4, 1),
    ]


@pytest.mark.parametrize(
    "layout",
    [
        {},
        {"big_endian": True},
        {"row_padding": 5},
        {"point_padding": 3},
        {"height": 2},
        {"height": 4, "row_padding": 1, "point_padding": 2, "big_endian": True},
    ],
    ids=str,
)
def test_decode_reads_every_legal_layout(layout):
    assert_columns(point_cloud.decode(good(**layout), WANTED))
    as_lists = {name: list(types) for name, types in WANTED.items()}
    assert_columns(point_cloud.decode(good(**layout), as_lists))


@pytest.mark.parametrize("big_endian", [False, True])
def test_decode_reads_wanted_fields_among_others(big_endian):
    fields = [("flag", 2), ("a", F8), ("depth", 3), ("n", U4), ("rest", F8)]
    rows = [(1, a, -5, n, np.nan) for a, n in ROWS]
    assert_columns(point_cloud.decode(cloud(fields, rows, big_endian=big_endian), WANTED))


def test_decode_keeps_precision_and_returns_writable_copies():
    found = point_cloud.decode(cloud([("a", F8)], [(1.0 + 1e-15,)]), {"a": point_cloud.FLOATS})
    assert found["a"][0] == 1.0 + 1e-15
    message = good()
    point_cloud.decode(message, WANTED)["a"][:] = 0.0
    assert_columns(point_cloud.decode(message, WANTED))


@pytest.mark.parametrize(
    "change",
    [
        {"datatype": U4},
        {"count": 2},
        {"offset": 1},
        {"offset": point_cloud.MAX_OFFSET + 1},
        {"name": "b"},
    ],
)
def test_decode_checks_each_clouds_own_layout(change):
    changed = good()
    for member, value in change.items():
        setattr(changed.fields[0], member, value)
    step = good()
    step.point_step -= 1
    for _ in range(2):
        assert_columns(point_cloud.decode(good(), WANTED))
        assert_columns(point_cloud.decode(good(big_endian=True), WANTED))
        if change == {"offset": 1}:
            shifted = np.frombuffer(bytes(changed.data), "<f4", 1, 1)[0]
            assert point_cloud.decode(changed, WANTED)["a"][0] == shifted
        else:
            assert rejection(changed)[0] == "schema"
        assert rejection(step)[0] == "schema"


@pytest.mark.parametrize(("height", "width"), [(1, 0), (0, 4), (0, 0), (3, 0)])
def test_decode_of_an_empty_cloud_is_empty(height, width):
    message = good()
    message.height, message.width, message.data = height, width, b""
    message.row_step = message.point_step * width
    assert [len(column) for column in point_cloud.decode(message, WANTED).values()] == [0, 0]


def test_decode_rejects_missing_fields_and_more_points_than_allowed():
    reason, text = rejection(good(), {"a": point_cloud.FLOATS, "missing": point_cloud.FLOATS})
    assert reason == "schema"
    assert "'missing'" in text
    assert "['a', 'n']" in text
    message = point_cloud.encode(0, "map", {"a": np.zeros(point_cloud.MAX_POINTS)})
    assert len(point_cloud.decode(message, {"a": point_cloud.FLOATS})["a"]) == 100_000


@pytest.mark.parametrize(
    "names", [["x" * 10**6], [f"field {k}" for k in range(10**4)]], ids=["long", "many"]
)
def test_decode_quotes_little_of_a_cloud_with_long_or_many_names(names):
    message = cloud([(name, F4) for name in names], [(1.0,) * len(names)])
    reason, text = rejection(message, {"missing": point_cloud.FLOATS})
    assert reason == "schema"
    assert "field 'missing' is missing; the cloud has [" in text
    assert len(text) < 3000


@pytest.mark.parametrize(
    ("name", "datatype"),
    [*(("a", kind) for kind in range(1, 7)), *(("n", kind) for kind in (1, 2, 3, 4, 5, 7, 8))],
)
def test_decode_rejects_a_field_of_another_type(name, datatype):
    kinds = {"a": F4, "n": U4, name: datatype}
    reason, text = rejection(cloud(list(kinds.items()), [(1, 1)]))
    assert reason == "schema"
    assert f"'{name}'" in text
    assert f"must be one of {'f4, f8' if name == 'a' else 'u4'}, count 1" in text


@pytest.mark.parametrize(
    ("part", "values", "words"),
    [
        ("datatype", (0, 9, 255), "'n' has type unknown"),
        ("count", (0, 2, 2**32 - 1), "'n' has type u4, count {}"),
        ("offset", (5, 8, 2**32 - 1), "field 'n' reaches beyond the point's step"),
    ],
)
def test_decode_rejects_a_field_that_makes_no_sense(part, values, words):
    for value in values:
        message = good()
        setattr(message.fields[1], part, value)
        reason, text = rejection(message)
        assert reason == "schema"
        assert words.format(value) in text


@pytest.mark.parametrize(
    "changes",
    [
        {"width": 5},
        {"width": 3},
        {"height": 2},
        {"row_step": 31},
        {"row_step": 33},
        {"row_step": 0},
        {"point_step": 9},
        {"point_step": 2**32 - 1},
        {"data": b"\0" * 31},
        {"data": b"\0" * 33},
        {"data": b""},
    ],
    ids=str,
)
def test_decode_rejects_steps_that_do_not_match_the_data(changes):
    message = good()
    for name, value in changes.items():
        setattr(message, name, value)
    if changes == {"width": 3}:
        message.row_step = 24  # Otherwise the row is a padded one
    reason, text = rejection(message)
    assert reason == "schema"
    assert f"{message.height} x {message.width} points" in text
    assert f"{len(message.data)} bytes" in text


@pytest.mark.parametrize(("height", "width"), [(1, 100_001), (2**32 - 1, 2**32 - 1), (317, 317)])
def test_decode_rejects_more_points_than_allowed_before_it_looks_further(height, width):
    message = good()
    message.height, message.width, message.fields = height, width, []
    reason, text = rejection(message)
    assert reason == "oversize"
    assert f"{height * width} points, at most 100000" in text


U32 = st.integers(0, 60) | st.sampled_from([2**31 - 8, 2**31 - 1, 2**31, 2**32 - 8, 2**32 - 1])
NAMES = st.sampled_from(["", "a", "x", "range", "azimuth", "amplitude", "lag", "p_class_0"])
SIZES = ("height", "width", "point_step", "row_step")
LEGAL = {
    "detections": lambda: detections.to_msg(samples.detections(), STAMP_NS, samples.FRAME),
    "truth": lambda: truth.to_msg(samples.truth(), "map"),
    "estimates": lambda: estimates.to_msg(samples.estimates(), "map"),
    "plain": good,
}


@st.composite
def malformed(draw, kind):
    """Draw a valid cloud with some of its metadata replaced."""
    message = LEGAL[kind]()
    if draw(st.booleans()):
        message.width, message.row_step, message.data = 0, 0, b""
    for name in draw(st.lists(st.sampled_from(SIZES), max_size=2)):
        setattr(message, name, draw(U32))
    for field in draw(st.lists(st.sampled_from(message.fields), max_size=2)):
        part = draw(st.sampled_from(["name", "offset", "datatype", "count"]))
        values = {"name": NAMES, "datatype": st.integers(0, 255)}.get(part, U32)
        setattr(field, part, draw(values))
    if draw(st.booleans()):
        message.fields = draw(st.permutations(message.fields))
    if draw(st.booleans()):
        count = draw(st.integers(0, 60))
        message.data = draw(st.binary(min_size=count, max_size=count))
    message.is_bigendian = draw(st.booleans())
    return message


def outcome(read, message):
    """Return what a reader makes of a message: a value, or the reason of its rejection."""
    try:
        return read(message)
    except RejectedMessageError as error:
        return error.reason


# `make fuzz` tries many more.
FUZZ = settings(max_examples=200, deadline=None)


@FUZZ
@given(malformed("plain"))
def test_decode_of_any_cloud_is_right_in_size_or_a_rejection(message):
    found = outcome(lambda cloud: point_cloud.decode(cloud, WANTED), message)
    if isinstance(found, dict):
        sizes = {len(column) for column in found.values()}
        assert sizes == {message.width * message.height}
    else:
        assert found in ("schema", "oversize")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("amplitude_field", ["amplitude", "power", ""])
@FUZZ
@given(message=malformed("detections"))
def test_detections_of_any_cloud_are_finite_or_a_rejection(amplitude_field, message):
    radar = samples.radar(amplitude_field=amplitude_field)
    found = outcome(lambda cloud: detections.from_msg(cloud, radar), message)
    if isinstance(found, str):
        assert found in ("schema", "oversize")
    else:
        assert np.isfinite(found.detections.measurement).all()
        total = len(found.detections) + sum(found.dropped.values())
        assert total == message.width * message.height


@pytest.mark.parametrize(("kind", "adapter"), [("truth", truth), ("estimates", estimates)])
@FUZZ
@given(data=st.data())
def test_other_adapters_of_any_cloud_give_a_value_or_a_rejection(kind, adapter, data):
    message = data.draw(malformed(kind))
    found = outcome(adapter.from_msg, message)
    if isinstance(found, str):
        assert found in ("schema", "oversize")
    else:
        assert len(found.state) == message.width * message.height
