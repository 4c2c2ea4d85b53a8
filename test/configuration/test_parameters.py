from dataclasses import fields

import numpy as np
import pytest

from phd_jdtc_ros.configuration.schema import Parameter
from phd_jdtc_ros.configuration.tables import GROUPS, TOP, parameters_of, schema
from phd_jdtc_ros.core.targets.motion import MOTIONS

WHOLE = Parameter("n", 5, "", 0, 10)
REAL = Parameter("x", 1.0, "", 0.0, 2.0)
FLAG = Parameter("f", False, "")
WORD = Parameter("w", "a", "", choices=("a", "b"))
NAMES = Parameter("names", ["p"], "", element=str)
PAIR = Parameter("pair", [0.0, 0.0], "", 0.0, 1.0, length=2)
FREE = Parameter("free", [0.5], "", 0.0, 1.0)


@pytest.mark.parametrize(
    ("parameter", "value", "expected"),
    [
        (WHOLE, 3, 3),
        (WHOLE, 3.0, 3),
        (WHOLE, np.int64(3), 3),
        (REAL, 2, 2.0),
        (REAL, np.float64(0.5), 0.5),
        (FLAG, True, True),
        (WORD, "b", "b"),
        (NAMES, ["q", "r"], ["q", "r"]),
        (NAMES, [], []),
        (PAIR, [0, 1], [0.0, 1.0]),
        (PAIR, (0.25, 0.5), [0.25, 0.5]),
        (PAIR, np.array([0.25, 0.5]), [0.25, 0.5]),
        (FREE, [], []),
    ],
)
def test_coerce_gives_the_type_of_the_default(parameter, value, expected):
    found = parameter.coerce(value)
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        (WHOLE, 2.5),
        (WHOLE, 11),
        (WHOLE, True),
        (WHOLE, "3"),
        (WHOLE, None),
        (WHOLE, float("inf")),
        (REAL, float("nan")),
        (REAL, -0.1),
        (REAL, 2.1),
        (REAL, [1.0]),
        (REAL, "auto"),
        (FLAG, 1),
        (FLAG, "true"),
        (WORD, "c"),
        (WORD, 1),
        (NAMES, ["p", "p"]),
        (NAMES, ["p", ""]),
        (NAMES, ["p", 1]),
        (NAMES, "p"),
        (PAIR, [0.5]),
        (PAIR, [0.5, 0.5, 0.5]),
        (PAIR, [0.5, float("nan")]),
        (PAIR, [0.5, 1.5]),
        (PAIR, ["0.5", "0.5"]),
        (PAIR, 0.5),
    ],
)
def test_coerce_refuses_what_is_not_allowed(parameter, value):
    assert parameter.coerce(value) is None


@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        (WHOLE, "a whole number, at least 0, at most 10"),
        (REAL, "a finite number, at least 0, at most 2"),
        (FLAG, "true or false"),
        (WORD, "one of a, b"),
        (NAMES, "a list of distinct names"),
        (PAIR, "a list of 2 finite numbers, at least 0, at most 1"),
        (FREE, "finite numbers, at least 0, at most 1"),
        (Parameter("s", "", ""), "a string"),
        (Parameter("y", 1.0, ""), "a finite number"),
    ],
)
def test_allowed_describes_what_a_parameter_may_be(parameter, words):
    assert parameter.allowed == words


def test_schema_gives_every_named_part_its_group_parameters():
    table = schema({"sensors": ["north"], "motions": ["cv"]})
    plain = [member for member in parameters_of("radar") if not member.keys]
    for member in plain:
        assert f"north.{member.name}" in table
    assert "radar_1.range_std" not in table
    assert "ct.model" not in table
    groups = {**GROUPS, "sensors": plain}
    assert len(table) == len(TOP) + sum(
        len(members) * count for members, count in zip(groups.values(), (1, 2, 1, 0), strict=True)
    )


def test_schema_has_the_entries_of_a_mapping_and_defaults_of_faulty_lists():
    table = schema({"radar_1.fields.time": "t", "radar_2.fields.no": "x"})
    assert "radar_1.fields.time" in table
    assert not [name for name in table if name.startswith("radar_2.fields")]
    assert "radar_1.range_std" in schema({"sensors": 3})


@pytest.mark.parametrize(("name", "parameter"), schema({}).items())
def test_every_parameter_accepts_its_own_default(name, parameter):
    assert parameter.name == name
    assert parameter.coerce(parameter.default) == parameter.default
    assert parameter.description.endswith(".")
    # A unit alone, or what is left of a sentence, is none.
    assert len(parameter.description.split()) >= 3


@pytest.mark.parametrize("name", MOTIONS)
def test_every_field_of_a_motion_is_a_parameter_of_motions(name):
    declared = {parameter.name for parameter in GROUPS["motions"]}
    # The axes of the states are the tracker's parameter `state`.
    assert {entry.name for entry in fields(MOTIONS[name])} - {"space"} <= declared
