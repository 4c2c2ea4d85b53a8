"""What any node tells of its health."""

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from phd_jdtc_ros.nodes.common.health import ALL_WELL, Condition, status_of, summary

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE
NODE = "/site/tracker"


def told(**lines):
    """Return level and message of the summary of lines, each with a level and a message."""
    found = summary(NODE, [status_of(NODE, line, Condition(*said)) for line, said in lines.items()])
    assert (found.name, found.hardware_id) == ("/site/tracker: summary", NODE)
    return found.level, found.message


def test_summary_of_lines_that_are_ok_is_that_all_is_well():
    assert told(north=(OK, "receiving"), outputs=(OK, "served")) == (OK, ALL_WELL)


@pytest.mark.parametrize("better", [OK, WARN, STALE])
@pytest.mark.parametrize("first", [False, True])
def test_summary_is_the_worst_line_whatever_its_place(better, first):
    lines = {"north": (better, "better"), "south": (ERROR, "its clock is 18 s ahead")}
    level, message = told(**(lines if first else dict(reversed(lines.items()))))
    assert level == ERROR
    assert message.startswith("south: its clock is 18 s ahead")
    assert ("not OK either: north" in message) == (better != OK)


def test_summary_takes_silence_for_worse_than_a_warning_and_names_each_line_once():
    assert told(north=(WARN, "late"), south=(STALE, "silent"), west=(STALE, "silent")) == (
        STALE,
        "south, west: silent; not OK either: north",
    )
