"""Sentences of AIS: values, parts, tag blocks and times of loggers."""

import math
from collections import Counter

import ais_sentences as made
import pytest

from phd_jdtc_ros.transponders.ais import AisReader
from phd_jdtc_ros.transponders.messages import KNOT, NONE

NOW_NS = 1_700_000_000 * 10**9


def reader():
    return AisReader(Counter(), 10 * 10**9)


def one(line, received_ns=NOW_NS):
    return reader().read(line, received_ns, "source")[0]


def test_published_sentences_have_their_published_values():
    # The examples of "AIVDM/AIVDO protocol decoding" (E. S. Raymond), with the values given there.
    heard = one(b"!AIVDM,1,1,,B,177KQJ5000G?tO`K>RA1wUbN0TKH,0*5C")
    assert heard.address == 477553000
    assert heard.latitude == pytest.approx(47.58283333, abs=1e-6)
    assert heard.longitude == pytest.approx(-122.34583333, abs=1e-6)
    assert (heard.speed, heard.course, heard.heading) == (0.0, 51.0, 181.0)
    assert heard.own_ns == 15_500_000_000


def test_class_a_is_read_as_it_was_made():
    heard = one(made.class_a(211000001, 42, 54.5, 10.25))
    assert (heard.address, heard.own_ns, heard.period_ns) == (211000001, 42_500_000_000, 6 * 10**10)
    assert heard.latitude == pytest.approx(54.5, abs=2e-6)
    assert heard.longitude == pytest.approx(10.25, abs=2e-6)
    assert heard.speed == pytest.approx(12.3 * KNOT)
    assert (heard.course, heard.heading, heard.accurate, heard.x_std) == (45.1, 47.0, 1, 4.0)


@pytest.mark.parametrize(
    ("fields", "name"),
    [({"speed": 1023}, "speed"), ({"course": 3600}, "course"), ({"heading": 511}, "heading")],
)
def test_values_that_are_not_available_are_unknown(fields, name):
    assert math.isnan(getattr(one(made.class_a(211000001, 42, **fields)), name))


@pytest.mark.parametrize("second", [60, 61, 62, 63])
def test_seconds_from_60_on_are_no_time(second):
    assert one(made.class_a(211000001, second)).own_ns == NONE


def test_coarse_positions_have_the_error_of_their_rounding():
    heard = one(made.coarse(211000001))
    assert heard.long_range
    assert heard.x_std == pytest.approx(math.hypot(12.0, 185.2 / math.sqrt(12.0)))


def test_names_types_and_dimensions_come_from_types_5_and_24():
    lines = made.voyage(211000001, "EVER DIADEM", 71, (225, 70, 1, 31))
    found = reader()
    assert found.read(lines[0], NOW_NS, "x") is None
    heard, _ = found.read(lines[1], NOW_NS, "x")
    assert (heard.name, heard.type, heard.hull) == ("EVER DIADEM", 71, (225, 70, 1, 31))
    (name,) = made.sentences(made.NAME, type=24, mmsi=211000002, name=made.text("ANNA", 120))
    (static,) = made.sentences(
        made.STATIC, type=24, mmsi=211000002, part=1, ship=36, bow=5, stern=6, port=1, starboard=2
    )
    assert one(name).name == "ANNA"
    assert (one(static).type, one(static).hull) == (36, (5, 6, 1, 2))


def test_craft_of_a_parent_ship_have_no_dimensions():
    (static,) = made.sentences(made.STATIC, type=24, mmsi=982110001, part=1, ship=36, bow=5)
    assert one(static).hull is None


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_parts_come_in_any_order_and_from_several_sources_at_once(order):
    first, second = made.voyage(211000001, "A SHIP"), made.voyage(211000002, "B SHIP")
    found = reader()
    heard = []
    for part in order:
        for lines, source in ((first, "a"), (second, "b")):
            heard.append(found.read(lines[part], NOW_NS, source))
    assert [each[0].name for each in heard if each] == ["A SHIP", "B SHIP"]


def test_parts_of_two_messages_are_not_mixed():
    first, second = made.voyage(211000001, "A SHIP"), made.voyage(211000002, "B SHIP")
    found = reader()
    assert found.read(first[0], NOW_NS, "a") is None
    # The same number again long after: the other half never came.
    assert found.read(second[1], NOW_NS + 20 * 10**9, "a") is None
    assert found.read(second[0], NOW_NS + 20 * 10**9, "a")[0].name == "B SHIP"
    assert found.counts["part_missing"] == 1


def test_incomplete_messages_are_bounded():
    found = reader()
    for number in range(2000):
        found.read(made.voyage(211000001, "A")[0], NOW_NS, f"source {number}")
    assert len(found._waiting) <= 500
    assert found.counts["part_missing"] == 1500


def test_every_damaged_byte_is_noticed():
    line = made.class_a(211000001, 42)
    for place in range(1, len(line) - 3):
        found = reader()
        damaged = line[:place] + bytes([line[place] ^ 1]) + line[place + 1 :]
        assert found.read(damaged, NOW_NS, "x") is None
        assert found.counts.total() == 1


def test_sentences_that_are_cut_are_malformed():
    body = made.class_a(211000001, 42).decode()[1:-3].split(",")
    for size in range(len(body[5])):
        fields = ",".join([*body[:5], body[5][:size], body[6]])
        line = f"!{fields}*{made.checksum(fields)}".encode()
        found = reader()
        heard = found.read(line, NOW_NS, "x")
        # The last fields are not used; without them the position is whole.
        assert (heard is None) == (6 * size < 143)
        assert heard is None or heard[0].own_ns == 42_500_000_000
        assert found.counts["malformed"] == (heard is None)


@pytest.mark.parametrize(
    "line",
    [
        lambda sentence: made.tagged(sentence, 1_699_999_998),
        lambda sentence: made.tagged(sentence, 1_699_999_998_000),
        lambda sentence: b"1699999998 " + sentence,
        lambda sentence: sentence + b",rx,1699999998",
    ],
    ids=["tag", "milliseconds", "before", "after"],
)
def test_lines_have_their_own_times_of_receipt(line):
    for received_ns in (None, NOW_NS):
        _, own_ns = reader().read(line(made.class_a(211000001, 42)), received_ns, "x")
        assert own_ns == 1_699_999_998 * 10**9


def test_times_of_receipt_far_from_the_clock_are_not_used():
    found = reader()
    line = made.tagged(made.class_a(211000001, 42), 1_600_000_000)
    assert found.read(line, NOW_NS, "x")[1] == NOW_NS
    assert found.counts == {"tag_time_off": 1}


def test_tag_blocks_with_a_wrong_checksum_are_not_used():
    found = reader()
    line = made.tagged(made.class_a(211000001, 42), 1_699_999_998).replace(b"s:st1", b"s:st2")
    assert found.read(line, NOW_NS, "x")[1] == NOW_NS
    assert found.counts == {"tag_checksum": 1}


def test_other_sentences_and_types_are_counted_by_name():
    found = reader()
    body = "GPZDA,120000,01,01,2024,,"
    lines = [f"${body}*{made.checksum(body)}".encode(), b"!AIVDM,1,1", b"!garbage*00"]
    lines += made.sentences((("type", 6), ("rest", 162)), type=21)
    for line in lines:
        assert found.read(line, NOW_NS, "x") is None
    assert found.counts == {"other_sentence": 1, "no_sentence": 1, "checksum": 1, "other_type": 1}


def test_base_stations_have_a_clock():
    day = {"year": 2024, "month": 2, "day": 29, "hour": 13, "minute": 14, "second": 15}
    (line,) = made.sentences(made.BASE, type=4, mmsi=2111234, **day)
    heard = one(line)
    assert (heard.clock, heard.own_ns) == (True, 1_709_212_455 * 10**9)
    (line,) = made.sentences(made.BASE, type=4, mmsi=2111234)
    assert one(line).own_ns == NONE
