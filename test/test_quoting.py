import pytest
from reference import resolve

from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.quoting import LONGEST, LONGEST_WORD, counted, counts_text, printable, short


def test_counts_text_lists_reasons_in_order_without_zeros():
    assert counts_text({"late": 2, "frame": 1, "jump": 0}) == "frame 1, late 2"


def test_short_leaves_words_and_keeps_both_ends_of_long_ones():
    text = f"/{'a' * (LONGEST_WORD - 2)}: has no section for this node,\n  it has none"
    assert short(text) == text
    assert short(f"lag: {'1' * 2500}{'2' * 2500} given, must be a whole number") == (
        f"lag: {'1' * 60} ... {'2' * 60} given, must be a whole number"
    )
    found = short("a " * 100_000 + "z")
    assert len(found) <= LONGEST + len(" ... ")
    assert found.endswith("a z")


@pytest.mark.parametrize("quoted", [short, printable])
def test_quotations_have_no_control_characters(quoted):
    assert quoted("/\x1b[2J\r\x9b\u202eé\n\tx") == "/\\x1b[2J\\r\\x9b\\u202eé\n\tx"


@pytest.mark.parametrize(
    "given",
    [
        {"lag": "9" * 5000},
        {"lag": 10**4000},
        {"a" * 5000: 1},
        {"sensors": ["a" * 5000, "a" * 5000]},
        {"sensors": ["a" * 5000], f"{'a' * 5000}.topic": 1},
        {"spawn.rate": "x" * 10**6},
    ],
)
def test_faults_of_a_configuration_quote_a_part_of_long_values(given):
    with pytest.raises(ConfigError) as caught:
        resolve(given)
    assert max(map(len, caught.value.faults)) < 600
    assert max(map(len, str(caught.value).splitlines())) < 600


@pytest.mark.parametrize(
    ("count", "said"),
    [(0, "0 clouds that are late"), (1, "1 cloud that is late"), (2, "2 clouds that are late")],
)
def test_what_is_counted_agrees_with_its_number(count, said):
    assert counted(count, "cloud[s] that [is|are] late") == said
