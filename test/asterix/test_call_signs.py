import pytest

from phd_jdtc_ros.asterix import call_signs
from phd_jdtc_ros.asterix.call_signs import MOST, CallSigns
from phd_jdtc_ros.asterix.messages import NONE


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
    assert call_signs.read(b"\xff" + data, 1) == expected


def test_call_signs_are_the_last_of_their_addresses_and_bounded():
    known = CallSigns()
    known.take(1, 100)
    known.take(1, 200)
    known.take(2, NONE)
    known.take(NONE, 300)
    assert [known.of(address) for address in (1, 2, NONE)] == [200, NONE, NONE]
    for address in range(2, MOST + 1):
        known.take(address, 7)
    # Received again, it is not the oldest.
    known.take(1, 200)
    known.take(MOST + 1, 7)
    assert (known.of(1), known.of(2)) == (200, NONE)
