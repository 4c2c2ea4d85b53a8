import pytest
from asterix import base
from asterix_records import block, category, plot, random_record, rng

from phd_jdtc_ros.asterix import specification
from phd_jdtc_ros.asterix.item_rules import Fixed, MalformedError
from phd_jdtc_ros.asterix.specification import layouts

CATEGORIES = (1, 2, 10, 34, 48, 62, 65)


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
            # libasterix takes a record that selects nothing.
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
