import math
from collections import Counter

import asterix_records as made
import asterix_reference
import pytest
from asterix import base
from asterix_records import block, category, plot, random_record, rng
from asterix_reference import value

from phd_jdtc_ros.asterix import framing, messages, plot_stream, specification
from phd_jdtc_ros.asterix.messages import (
    DAY,
    MOST_CALL_SIGNS,
    NONE,
    TRUNCATED,
    CallSigns,
    Plot,
    ServiceMessage,
)
from phd_jdtc_ros.asterix.plot_stream import TRAILERS, BlockReader
from phd_jdtc_ros.asterix.specification import Fixed, MalformedError, layouts

FOOT = 0.3048
GOOD = made.plots(made.plot(1.0, 5.0))
TRAILER = b"\xee\xff\x00\x01abcd"
CATEGORIES = (1, 2, 10, 34, 48, 62, 65)


def read(data):
    """Return the messages of data blocks, and what was left out."""
    counts = Counter()
    return list(plot_stream.BlockReader(counts).messages(data)), +counts


def one(**items):
    (found,), counts = read(made.plots(made.plot(10.0, 5.0, **items)))
    assert not counts
    return found


def assert_same(found, record):
    """Compare a plot of ours with the record of the other decoder."""
    assert found.radar == value(record, "I010", "SAC") * 256 + value(record, "I010", "SIC")
    assert found.time_of_day / 128.0 == value(record, "I140", "ToD")
    assert found.distance == value(record, "I040", "RHO") * 1852.0
    assert found.azimuth == pytest.approx(math.radians(value(record, "I040", "THETA")), abs=1e-12)
    assert found.detection_type == (value(record, "I020", "TYP") or 0)
    address = value(record, "I220", "ACAddr")
    assert found.address == (NONE if address is None else int(address, 16))
    known = "I070" in record and not value(record, "I070", "V") and not value(record, "I070", "G")
    assert found.code == (int(value(record, "I070", "Mode3A"), 8) if known else NONE)
    usable = "I090" in record and not value(record, "I090", "V") and not value(record, "I090", "G")
    level = value(record, "I090", "FL") if usable else None
    feet = value(record, "I110", "3D_Height") if level is None else 100.0 * level
    assert found.height == pytest.approx(math.nan if feet is None else feet * FOOT, nan_ok=True)
    for dbm, names in (
        (found.primary_dbm, ("PAMP", "PAM")),
        (found.secondary_dbm, ("SAMP", "SAM")),
    ):
        known = value(record, "I130", *names)
        assert dbm == pytest.approx(math.nan if known is None else known, nan_ok=True)


def test_plots_are_those_that_another_decoder_reads():
    rng = made.rng(48)
    records = []
    for _ in range(150):
        items = {
            "020": ((int(rng.integers(1, 8)), 0, 0, 0, 0, None),),
            "070": int(rng.integers(2**16)) & 0xEFFF,
            "090": int(rng.integers(2**16)),
            "110": int(rng.integers(2**14)),
            "130": {name: int(rng.integers(256)) for name in ("SRL", "SRR", "SAM", "PRL", "PAM")},
            "220": int(rng.integers(1, 2**24)),
        }
        kept = {name: item for name, item in items.items() if rng.random() < 0.7}
        far, azimuth = float(rng.integers(2**16)) / 256.0, float(rng.uniform(0.0, 359.9))
        record = made.plot(
            azimuth, float(rng.uniform(0.0, 86399.0)), far, sic=int(rng.integers(256))
        )
        records.append({**record, **{f"{k}": v for k, v in kept.items()}})
    data = b"".join(made.plots(*records[k : k + 7]) for k in range(0, len(records), 7))
    found, counts = read(data)
    assert not counts
    assert len(found) == 150
    for own, record in zip(found, asterix_reference.decoded(data), strict=True):
        assert_same(own, record)


def test_a_real_capture_has_the_plots_that_another_decoder_reads():
    data = asterix_reference.sample("cat_034_048.pcap")
    plots = services = 0
    for received in framing.datagrams(data, None, Counter()):
        found, _ = read(received.data)
        records = asterix_reference.decoded(received.data)
        records = [r for r in records if r["category"] == 34 or value(r, "I020", "TYP")]
        for record, message in zip(records, found, strict=True):
            if record["category"] == 48:
                assert_same(message, record)
                plots += 1
            else:
                assert message.kind == value(record, "I000", "MsgTyp")
                assert message.time_of_day / 128.0 == value(record, "I030", "ToD")
                azimuth = value(record, "I020", "Azi")
                if azimuth is not None:
                    assert math.degrees(message.azimuth) == pytest.approx(azimuth)
                services += 1
    assert (plots, services) == (126, 34)


def test_positions_are_of_the_plane_or_the_services_and_zero_is_no_address():
    assert one(i220=0).address == NONE
    assert one(i220=0xFFFFFF).address == 0xFFFFFF
    record = made.plot(0.0, 5.0)
    del record["040"]
    (found,), counts = read(made.plots({**record, "042": (("X", -3.0), ("Y", -4.0))}))
    assert not counts
    assert found.distance == pytest.approx(5.0 * 1852.0)
    assert math.degrees(found.azimuth) == pytest.approx(180.0 + math.degrees(math.atan2(3, 4)))
    data = made.north(7.0, sac=3, sic=4, rotation_s=4.0) + made.sector(90.0, 8.0, sac=3, sic=4)
    (mark, crossing), counts = read(data)
    assert not counts
    assert mark == ServiceMessage(0x0304, 7 * 128, 1, 0.0, 4.0)
    assert crossing[:4] == (0x0304, 8 * 128, 2, math.pi / 2)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"040": None}, "no_position"),
        ({"010": None}, "no_radar"),
        ({"020": ((0, 0, 0, 0, 0, None),)}, "no_detection"),
        ({"020": ((3, 0, 0, 0, 1, None),)}, "field_monitor"),
        ({"020": ((3, 0, 0, 0, 0, None), (1, 0, 0, 0, 0, 0, None))}, "test_target"),
    ],
)
def test_what_is_no_targets_plot_is_counted(change, reason):
    good = made.plot(20.0, 6.0)
    found, counts = read(made.plots({**made.plot(10.0, 5.0), **change}, good))
    assert [plot.time_of_day for plot in found] == [6 * 128]
    assert counts == {reason: 1}


@pytest.mark.parametrize("track", [False, True])
def test_old_radars_have_truncated_times(track):
    uap = made.category(1).cv_uap.spec("track" if track else "plot")
    items = {
        "010": 0x0506,
        "020": ((int(track), 0, 3, 0, 0, 0, None),),
        "040": (("RHO", 25.0), ("THETA", 2**14)),
        "070": (0, 0, 0, 0, 0o1234),
        "090": (0, 0, 40),
        "131": 0xC8,
        "141": 0xFFFE,
        **({"161": 7} if track else {}),
    }
    record = uap.create(items).unparse().to_bytes()
    (found,), counts = read(b"\x01" + (len(record) + 3).to_bytes(2, "big") + record)
    assert not counts
    expected = Plot(
        0x0506, 0xFFFE, TRUNCATED, 46_300.0, math.pi / 2, 304.8, 0o1234, NONE, 3, -56.0, math.nan
    )
    assert found == pytest.approx(expected, nan_ok=True)


def test_surface_radars_have_ranges_in_metres():
    items = {
        "010": 0x0708,
        "000": 1,
        "020": ((3, 0, 0, 0, 0, None),),
        "140": 100,
        "040": 1500 << 16 | 2**15,
    }
    found, counts = read(made.block(10, [items, {**items, "000": 2}]))
    assert not counts
    assert [(p.distance, p.azimuth, p.detection_type) for p in found] == [(1500.0, math.pi, 1)]
    assert found[0].period == DAY


def test_a_block_without_records_does_not_hide_those_behind_it():
    good = made.plots(made.plot(10.0, 5.0))
    found, counts = read(b"\x30\x00\x03" + good)
    assert (len(found), counts) == (1, {})


def test_blocks_before_a_wrong_length_are_used():
    good = made.plots(made.plot(10.0, 5.0))
    for rest, reason in (
        (b"\x30\x00\x02", "block_length"),
        (b"\x30\x00\x00" + bytes(50), "block_length"),
        (b"\x30\xff\xff" + bytes(50), "block_truncated"),
        (b"\x30", "block_truncated"),
    ):
        found, counts = read(good + rest)
        assert len(found) == 1
        assert counts == {reason: 1}


def test_records_before_a_malformed_one_are_used_and_empty_ones_refused():
    good = made.plots(made.plot(10.0, 5.0))
    broken = good[3:] + b"\xff\xff\xff\xff\xff"
    data = good + b"\x30" + (len(broken) + 3).to_bytes(2, "big") + broken + good
    found, counts = read(data)
    assert len(found) == 3
    assert sum(counts.values()) == 1
    found, counts = read(b"\x30\xff\xff" + bytes(65_532))
    assert (found, counts) == ([], {"empty_record": 1})


def packed(*characters):
    """Return eight characters of six bits each."""
    return sum(c << 42 - 6 * k for k, c in enumerate(characters)).to_bytes(6, "big")


KLM12 = packed(11, 12, 13, 49, 50, 32, 32, 32)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (KLM12, int.from_bytes(KLM12, "big")),
        (packed(*[32] * 8), NONE),
        (bytes(6), NONE),
        (packed(11, 12, 63, 49, 50, 32, 32, 32), NONE),
    ],
    ids=["name", "blank", "zeros", "garbled"],
)
def test_read_takes_names_and_nothing_else(data, expected):
    assert messages.read_call_sign(b"\xff" + data, 1) == expected
    assert messages.call_sign_text(expected) == ("" if expected == NONE else "KLM12")


def test_call_signs_are_the_last_of_their_addresses_and_bounded():
    known = CallSigns()
    known.take(1, 100)
    known.take(1, 200)
    known.take(2, NONE)
    known.take(NONE, 300)
    assert [known.of(address) for address in (1, 2, NONE)] == [200, NONE, NONE]
    for address in range(2, MOST_CALL_SIGNS + 1):
        known.take(address, 7)
    # Received again, it is not the oldest.
    known.take(1, 200)
    known.take(MOST_CALL_SIGNS + 1, 7)
    assert (known.of(1), known.of(2)) == (200, NONE)


@pytest.fixture
def reader():
    return BlockReader(Counter())


def test_trailer_of_every_datagram_is_no_fault(reader):
    for _ in range(10):
        assert len(list(reader.messages(GOOD + TRAILER))) == 1
    assert not +reader.counts
    assert reader.known_trailers() == {8: 10}


def test_rests_of_other_lengths_beside_trailers_are_faults(reader):
    for size in (8, 8, 8, 8, 5, 11):
        list(reader.messages(GOOD + TRAILER[:4] + bytes(size - 4)))
    assert reader.counts == {"block_truncated": 2}


def test_few_rests_are_faults(reader):
    for _ in range(TRAILERS - 1):
        list(reader.messages(GOOD + TRAILER))
    assert reader.counts == {"block_truncated": TRAILERS - 1}
    assert reader.known_trailers() == {}


@pytest.mark.parametrize("data", [GOOD + GOOD[:8], TRAILER], ids=["cut blocks", "nothing else"])
def test_rests_that_are_no_trailers_are_faults(reader, data):
    for _ in range(10):
        list(reader.messages(data))
    assert reader.counts == {"block_truncated": 10}


def test_records_are_counted_by_category_whether_read_or_not(reader):
    status = b"\x41" + (9).to_bytes(2, "big") + b"\x80\x01\x02" * 2
    list(reader.messages(made.plots(made.plot(1.0, 5.0), made.plot(2.0, 5.0)) + status))
    assert reader.categories == {48: 2, 65: 2}
    assert reader.counts == {"other_category": 1}


def test_unknown_category_is_counted_by_its_blocks(reader):
    list(reader.messages(b"\xff\x00\x05ab" * 3))
    assert reader.categories == {255: 3}


def kinds():
    return [(number, name) for number in CATEGORIES for name in layouts(number)]


def of_libasterix(number, name):
    uap = category(number).cv_uap
    return uap.cv_uaps[name] if name else uap.cv_record


@pytest.mark.parametrize(("number", "name"), kinds())
def test_walk_finds_every_item_where_libasterix_does(number, name):
    layout, reference = layouts(number)[name], of_libasterix(number, name)
    generator = rng(number)
    for _ in range(60):
        data, chosen = random_record(layout, generator)
        parsed = reference.parse(base.ParsingMode.StrictParsing, base.Bits.from_bytes(data))
        assert not isinstance(parsed, ValueError), parsed
        record, rest = parsed
        assert len(rest) == 0
        begins, end = layout.walk(data + b"\xff", 0, len(data))
        assert end == len(data)
        assert {layout.names[k] for k, begin in enumerate(begins) if begin >= 0} == {*chosen}
        bounds = sorted(begin for begin in begins if begin >= 0)
        for begin, after in zip(bounds, [*bounds[1:], end], strict=True):
            item = record.get_item(layout.names[begins.index(begin)])
            assert data[begin:after] == item.unparse().to_bytes()


@pytest.mark.parametrize(("number", "name"), kinds())
def test_walk_refuses_what_libasterix_refuses(number, name):
    layout, reference = layouts(number)[name], of_libasterix(number, name)
    generator = rng(100 + number)
    refused = 0
    for _ in range(150):
        data = bytearray(random_record(layout, generator)[0])
        for _ in range(generator.integers(1, 4)):
            data[generator.integers(len(data))] = generator.integers(256)
        data = bytes(data[: generator.integers(1, len(data) + 1)])
        try:
            _, end = layout.walk(data, 0, len(data))
        except MalformedError as error:
            end = None
            # A record that selects nothing is valid for libasterix.
            if error.reason == "empty_record":
                continue
        parsed = reference.parse(base.ParsingMode.StrictParsing, base.Bits.from_bytes(data))
        refused += isinstance(parsed, ValueError)
        taken = None if isinstance(parsed, ValueError) else len(data) - len(parsed[1]) // 8
        assert end == taken, data.hex()
    assert refused > 10


def test_walk_is_bounded_in_length_and_plans():
    data = block(48, [plot(10.0, 5.0)])[3:]
    layout = layouts(48)[""]
    for limit in range(len(data)):
        with pytest.raises(MalformedError):
            layout.walk(data, 0, limit)
    layout = specification.Layout(("a", "b"), (Fixed(1),) * 2)
    layout._plans.update({bytes([k % 256, k // 256, 1]): None for k in range(5000)})
    assert layout.walk(b"\xc0\x01\x02", 0, 3) == ([1, 2], 3)
    assert len(layout._plans) == 1


def test_endless_extension_and_unknown_category_are_refused():
    layout = layouts(48)[""]
    for data in (b"\xff" * 65_000, b"\x20" + b"\xff" * 65_000):
        with pytest.raises(MalformedError) as caught:
            layout.walk(data, 0, len(data))
        assert caught.value.reason in ("fspec", "extension", "truncated")
    with pytest.raises(KeyError):
        layouts(255)
