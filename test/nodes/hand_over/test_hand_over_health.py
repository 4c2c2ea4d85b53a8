"""The health of the hand-over."""

from collections import Counter
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus

from phd_jdtc_ros.core.types import FILTERED, SMOOTHED
from phd_jdtc_ros.handover.picture import LATEST_STAMPS
from phd_jdtc_ros.handover.settings import TABLE
from phd_jdtc_ros.nodes import hand_over

LIMIT_S = next(parameter.default for parameter in TABLE if parameter.name == "max_delay_s")


def history_at(*times):
    """Return the history of a tracker with a filtered and a smoothed cloud at each time."""
    heard = hand_over.TrackerHealth(LIMIT_S)
    for time_s in times:
        heard.take(FILTERED, time_s)
        heard.take(SMOOTHED, time_s + 0.1)
    return heard


def status(heard, now_s, silent=False, behind_s=0.0):
    return heard.status("/hand_over", "west", "/west/tracker", behind_s, silent, now_s)


def test_a_tracker_is_silent_after_its_usual_revolution_and_not_after_one_pause():
    for revolution_s in (6.0, 12.0):
        heard = history_at(*(revolution_s * revolution for revolution in range(4)))
        last_s = 3.0 * revolution_s + 0.1
        assert status(heard, last_s + revolution_s + LIMIT_S - 0.1).level == DiagnosticStatus.OK
        found = status(heard, last_s + revolution_s + LIMIT_S + 0.1)
        assert found.message == f"silent for {revolution_s + LIMIT_S + 0.1:.1f} s"
    assert status(history_at(0.0), 12.0).level == DiagnosticStatus.OK
    assert status(history_at(0.0), 18.0).level == DiagnosticStatus.WARN
    heard = history_at(0.0, 1.0, 2.0, 3.0, 300.0)
    assert heard.is_quiet(307.0)


def test_a_tracker_whose_clouds_are_refused_is_not_called_silent():
    heard = history_at(0.0, 1.0)
    heard.refuse("frame")
    found = status(heard, 2.0, silent=True, behind_s=300.0)
    assert found.message == "left out: frame 1; the picture is without it"


def picture(alive=("west", "east"), uncommon_stamps=0, published=3):
    counts = Counter({FILTERED: published} if published else {})
    joint = SimpleNamespace(handed_over=1, uncommon_stamps=uncommon_stamps, overflow=0)
    return hand_over.of_picture("/hand_over", joint, counts, 4, alive)


def test_picture_of_trackers_that_are_all_there_is_well():
    assert picture().level == DiagnosticStatus.OK
    assert picture(uncommon_stamps=LATEST_STAMPS // 2).level == DiagnosticStatus.OK


def test_picture_warns_where_trackers_are_missing():
    for given, words in (
        ({"alive": ()}, "all trackers are silent"),
        ({"alive": ("east",)}, "of one tracker alone: east"),
        ({"published": 0}, "nothing published"),
        (
            {"uncommon_stamps": 9},
            "stamps are not common: 9 of the last 10 are of some trackers only; set ",
        ),
    ):
        found = picture(**given)
        assert found.level == DiagnosticStatus.WARN
        assert found.message.startswith(words)
