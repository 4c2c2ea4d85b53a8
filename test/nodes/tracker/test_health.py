import math
import re
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters.outgoing import diagnostics
from phd_jdtc_ros.calibration.innovations import Fit
from phd_jdtc_ros.configuration.engines import ENGINES
from phd_jdtc_ros.configuration.tables import TOP
from phd_jdtc_ros.nodes.common.health import WARNING_MEMORY_S, Rhythm, Rises, ThrottledWarnings
from phd_jdtc_ros.nodes.tracker.health import (
    LEASE_S,
    InputHealth,
    Load,
    OutputHealth,
    Publishers,
    StepHealth,
)

ALONE = Publishers(frozenset({"driver"}))
PAIR = ("range", "azimuth")
TWO = Publishers(frozenset({"driver", "other"}))
OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE


def radar(interval_s=None, scans=9):
    """Return a radar's health at second 100, after regular reports up to there."""
    health = InputHealth("north", "/north/plots", Rhythm(6.0))
    if interval_s is not None:
        for k in range(scans):
            now = 100.0 - (scans - 1 - k) * interval_s
            health.note_message(now, k, 0.0)
            health.rhythm.beat(now)
    return health


def status(health, now_s=100.0, heard=ALONE, checked_s=None):
    """Return the status; without `checked_s` of a tracker that is never late."""
    checked_s = now_s if checked_s is None else checked_s
    return health.status("/site/tracker", now_s, checked_s, heard)


def step_status(pace, lost=0, busy=0.1):
    return pace.status("/site/tracker", lost, busy)


def stepping(step_ms, interval_s=2, wall_s=None):
    """Return the health after a dozen steps."""
    pace = StepHealth(Rhythm(6.0), Rhythm(6.0))
    wall_s = interval_s if wall_s is None else wall_s
    for index in range(12):
        pace.note_step(index * interval_s * 10**9, index * wall_s, step_ms)
    return pace


def test_rhythm_is_the_median_of_intervals_without_pauses():
    rhythm = Rhythm(6.0)
    assert rhythm.interval_s == 6.0
    for now in (0.0, 1.0, 2.0, 3.0, 50.0, 51.0, 52.0):
        rhythm.beat(now)
    assert rhythm.interval_s == 1.0
    rhythm = Rhythm(6.0)
    rhythm.beat(10.0)
    rhythm.beat(10.001)
    assert rhythm.interval_s > 3.0
    rhythm = Rhythm(6.0)
    rhythm.beat(0.0)
    rhythm.begin_series()
    rhythm.beat(1000.0)
    assert rhythm.interval_s == 6.0


@pytest.mark.parametrize("interval_s", [0.1, 1.0, 12.0])
def test_radar_is_silent_within_two_of_its_own_scans_and_half_a_second(interval_s):
    health = radar(interval_s)
    assert not health.silent(100.0 + 2.0 * interval_s)
    # A tenth of a second is left for whoever looks.
    assert health.silent(100.0 + 2.0 * interval_s + 0.4)
    found = status(health, 100.0 + 2.0 * interval_s + 0.4)
    assert found.level == STALE
    assert found.message.startswith("silent for ")


def test_radar_without_messages_is_stale_or_of_incompatible_qos():
    found = status(radar())
    assert (found.level, found.message) == (STALE, "nothing received yet")
    assert "age_s" not in diagnostics.values_of(found)
    found = status(radar(), heard=Publishers(frozenset({"driver"}), ("best effort and reliable",)))
    assert found.level == ERROR
    assert found.message == "incompatible QoS on /north/plots: best effort and reliable"


def test_reporting_radar_is_ok_with_its_figures():
    found = status(radar(1.0), 100.5)
    assert (found.name, found.hardware_id) == ("/site/tracker: north", "/site/tracker/north")
    assert (found.level, found.message) == (OK, "receiving")
    assert diagnostics.values_of(found) == {
        "topic": "/north/plots",
        "received": "9",
        "age_s": "0.5",
        "interval_s": "1.0",
        "gaps": "0",
        "deadlines_missed": "0",
        "incompatible_qos": "0",
        "publishers": "1",
    }


@pytest.mark.parametrize(("offset_s", "way"), [(18.0, "ahead of"), (-3600.0, "behind")])
def test_radar_whose_clock_is_wrong_is_an_error_with_the_offset(offset_s, way):
    health = radar(1.0)
    health.clock_offset_s = offset_s
    found = status(health)
    assert found.level == ERROR
    named = f"its stamps are {abs(offset_s)} s {way} those of the other sensors"
    assert found.message.startswith(named)
    assert diagnostics.values_of(found)["clock_offset_s"] == str(offset_s)


@pytest.mark.parametrize("trouble", ["drop", "deadline"])
def test_radar_in_trouble_is_a_warning_for_a_while(trouble):
    health = radar(60.0)
    if trouble == "drop":
        health.dropped["schema"] += 3
    else:
        health.deadlines_missed += 3
    values = diagnostics.values_of(status(health))
    assert "3" in (values["deadlines_missed"], values.get("dropped_schema"))
    found = status(health, 100.0 + 0.9 * WARNING_MEMORY_S)
    said = "messages dropped: schema 3" if trouble == "drop" else "a deadline was missed"
    assert (found.level, found.message) == (WARN, said)
    assert status(health, 100.0 + 1.1 * WARNING_MEMORY_S).level == OK


def test_anomalies_are_counted_and_a_warning_for_a_while():
    health = radar(60.0)
    health.anomalies += Counter(time_missing=2)
    health.warn("no times")
    found = status(health)
    assert (found.level, found.message) == (WARN, "no times")
    assert diagnostics.values_of(found)["time_missing"] == "2"
    assert status(health, 100.0 + 1.1 * WARNING_MEMORY_S).level == OK


def warned_of(faults, seconds, per_s=50, note=InputHealth.note_single):
    """Return in which seconds a radar is in WARN; `faults` of its detections have a fault each."""
    health, levels = radar(60.0), []
    for second in range(seconds):
        health.note_message(100.0 + second, None, 0.0)
        health.detections += per_s
        if count := faults(second):
            note(health, "height", count, f"{count} without a height", 100.0 + second)
        found = status(health, 100.0 + second)
        levels.append(found.level)
        assert found.level == OK or "without a height" in found.message
    return [second for second, level in enumerate(levels) if level == WARN]


@pytest.mark.parametrize("note", [InputHealth.note_single, InputHealth.note_dropped])
def test_single_faults_among_hundreds_of_detections_are_no_warning(note):
    assert not warned_of(lambda second: second % 8 == 0, 120, note=note)
    # Not in the first of few detections either.
    assert not warned_of(lambda second: second == 0, 20, per_s=2, note=note)


@pytest.mark.parametrize("note", [InputHealth.note_single, InputHealth.note_dropped])
def test_single_faults_warn_while_they_are_many_and_not_now_and_then(note):
    # From 8 % to 3 % and to none, each for two minutes.
    share = {0: 4, 1: 1.5, 2: 0}
    found = warned_of(lambda second: int(share[second // 120] * (1 + second % 2)), 360, note=note)
    assert found == list(range(found[-1] + 1))
    assert 240 <= found[-1] < 300
    assert not warned_of(lambda second: int(1.5 * (1 + second % 2)), 240, note=note)


def test_primary_plots_among_replies_are_no_warning_and_a_radar_without_any_height_is():
    health = radar(1.0)
    health.detections = 100
    assert not health.note_single("heights_unknown", 40, "40 detections without a height", 100.0)
    assert health.note_single("heights_unknown", 20, "20 detections without a height", 100.0)
    assert status(health).message == "60 % in the last minute: detections without a height"


def test_late_clouds_are_judged_by_their_share_of_the_clouds():
    health = radar(1.0, scans=80)
    assert not health.note_single("late_reworked", 2, "2 clouds reprocessed", 100.0)
    assert status(health).level == OK
    assert health.note_single("late_reworked", 3, "3 clouds reprocessed", 100.0)
    assert status(health).message == "6 % in the last minute: clouds reprocessed"


def test_what_was_learned_is_shown_and_a_warning_if_it_is_worse_than_set():
    health = radar(60.0)
    health.learned = {"range_noise_ratio": 1.1, "range_noise_ratio_std": 0.05}
    assert status(health).level == OK
    assert diagnostics.values_of(status(health))["range_noise_ratio"] == "1.1"
    health.learned = {"range_noise_ratio": 2.0, "range_noise_ratio_std": 0.05}
    assert status(health).level == WARN
    assert status(health).message.startswith(
        "worse than configured, tracked with the learned values: its range"
    )
    health.learned = {"range_noise_ratio": 1.4, "range_noise_ratio_std": 0.05}
    assert status(health).level == WARN
    health.learned = {"range_noise_ratio": 1.2, "range_noise_ratio_std": 0.05}
    assert status(health).level == OK


def test_noise_that_detections_contradict_is_a_warning_as_long_as_they_do():
    health = radar(60.0)
    none, first, both = np.zeros(2, bool), np.array([True, False]), np.ones(2, bool)
    noise, innovations = np.array([30.0, 1.1]), np.array([40.0, 1.5])
    health.fit = Fit("north", PAIR, 99, innovations, noise, first, none)
    found = status(health)
    assert found.level == WARN
    assert found.message.startswith(
        "innovations are 30 times larger than the noise predicts (ranges are off by 30 times "
        "range_std); check north.range_std, or"
    )
    values = diagnostics.values_of(found)
    assert (values["range_innovation"], values["azimuth_innovation"]) == ("40.0", "1.5")
    health.fit = health.fit._replace(noise=np.array([0.2, 0.3]), too_small=none, too_large=both)
    assert status(health).message.startswith(
        "innovations are 5 times smaller than the noise predicts (ranges are off by 0.2 times "
        "range_std, azimuths are off by 0.3 times azimuth_std_deg; errors that stay, "
    )
    health.fit = health.fit._replace(too_large=none)
    assert status(health).level == OK


def test_second_publisher_is_a_warning_that_silence_does_not_hide():
    found = status(radar(1.0), heard=TWO)
    assert found.level == WARN
    assert found.message.startswith("2 publishers listed on /north/plots, must be one")
    assert diagnostics.values_of(found)["publishers"] == "2"
    found = status(radar(1.0), 110.0, heard=TWO)
    assert found.level == STALE
    assert found.message.startswith("silent for 10.0 s; 2 publishers listed on /north/plots, must")


def test_what_came_during_a_pause_is_neither_lost_nor_an_interval():
    health = radar(1.0)
    health.begin_series()
    assert status(health, 200.0).message == "nothing received yet"
    health.note_message(200.0, 70, 0.0)
    health.rhythm.beat(200.0)
    assert (health.gaps, health.rhythm.interval_s) == (0, 1.0)
    health.note_message(201.0, 73, 0.0)
    assert health.gaps == 2


def test_publishers_that_alternate_are_an_error_whatever_the_graph_shows():
    health = radar(1.0)
    for k in range(4):
        health.note_message(100.0 + k, 500 + k, 0.0)
        health.note_message(100.5 + k, 9 + k, 0.0)
    found = status(health, 104.0)
    assert (found.level, found.message) == (
        ERROR,
        "several publishers on /north/plots, must be one",
    )
    # Without a publisher the case is another one.
    assert status(health, 114.0).level == STALE


def test_second_publishers_are_errors_once_they_outlive_a_killed_one():
    health = radar(1.0)
    for k in range(40):
        health.note_message(101.0 + k, 1 + k, 0.0)
        found = status(health, 101.0 + k, TWO if k < 20 else ALONE)
        assert found.level == (WARN if k < 20 else OK)
    assert health.gaps == 0
    health = radar(1.0)
    for after_s, level in ((0.0, WARN), (LEASE_S - 1.0, WARN), (LEASE_S + 1.0, ERROR)):
        health.note_message(100.0 + after_s, None, 0.0)
        assert status(health, 100.0 + after_s, TWO).level == level
    assert status(health, 100.0 + LEASE_S + 1.0).level == OK


@pytest.mark.parametrize("restart_s", [5.0, 19.0])
def test_publisher_that_is_restarted_again_and_again_is_no_error(restart_s):
    health = radar()
    for second in range(200):
        # A killed one stays in the graph for 20 s.
        listed = {second // restart_s - k for k in range(5) if k * restart_s < 20.0}
        assert status(health, float(second), Publishers(frozenset(listed))).level == STALE


@pytest.mark.parametrize(
    ("worked_s", "why"),
    [(0.9, "the tracker is too slow, see its step time"), (0.1, "on the way to the tracker")],
)
def test_lost_messages_are_a_warning_with_the_cause(worked_s, why):
    health = radar(1.0)
    health.note_message(101.0, 9, worked_s)
    assert status(health, 101.0).level == OK
    # Five are missing, in a second of which the tracker worked that part.
    health.note_message(102.0, 15, 2 * worked_s)
    found = status(health, 102.0)
    assert (found.level, found.message) == (WARN, f"5 messages lost in the last 10 s: {why}")
    assert diagnostics.values_of(found)["gaps"] == "5"
    assert health.lost_by_overload(102.0) == (5 if worked_s > 0.5 else 0)
    health.rhythm = Rhythm(60.0)
    assert status(health, 102.1 + WARNING_MEMORY_S).level == OK


def test_radar_is_not_silent_while_the_tracker_is_too_busy_to_look():
    health = radar(0.05)
    # The tracker worked for 5 s: what waits in its queue has not been received yet.
    assert status(health, 105.0, checked_s=100.0).level == OK
    assert not health.silent(100.0)
    # It has looked since, and there was nothing.
    assert status(health, 105.2, checked_s=105.1).level == STALE


@pytest.mark.parametrize(("step_ms", "level"), [(1999.0, OK), (2001.0, WARN)])
def test_step_time_is_judged_by_the_scans_true_interval(step_ms, level):
    found = step_status(stepping(step_ms))
    assert (found.name, found.hardware_id) == ("/site/tracker: step time", "/site/tracker")
    assert found.level == level
    assert diagnostics.values_of(found)["scan_interval_ms"] == "2000.0"


def test_step_times_and_approximations_are_counted_once_there_are_scans():
    assert step_status(StepHealth(Rhythm(6.0), Rhythm(6.0))).level == STALE
    pace = StepHealth(Rhythm(2.0), Rhythm(2.0))
    for index, count in enumerate((0, 2, 0, 1)):
        figures = {"approximate_clusters": count, "floored_covariances": 1, "origins": 9}
        pace.note_step(index * 10**9, float(index), 1.0, 1, figures)
    values = diagnostics.values_of(step_status(pace))
    assert (values["approximate_clusters"], values["floored_covariances"]) == ("3", "4")
    assert "origins" not in values
    assert "approximate_clusters" not in diagnostics.values_of(step_status(stepping(1.0)))


def test_overload_is_a_warning_with_advice_though_each_step_is_in_time():
    # The scans that are left after the losses are far apart, so each step is fast enough for them.
    pace = stepping(800.0)
    assert step_status(pace).level == OK
    found = step_status(pace, lost=453, busy=0.99)
    assert found.level == WARN
    assert found.message == (
        "overloaded, 453 messages lost in the last 10 s: turn down accuracy or lag"
    )
    assert diagnostics.values_of(found)["busy"] == "0.99"


@pytest.mark.parametrize("engine", ENGINES)
def test_advice_on_slow_steps_names_parameters_of_the_engine(engine):
    found = step_status(StepHealth(Rhythm(2.0), Rhythm(2.0), engine, step_ms=3000.0))
    advised = re.findall(r"accuracy|particles|lag", found.message)
    with_particles = engine in ("phd", "phd_as_printed")
    of_particles = ["particles"] if with_particles else []
    accuracy = [] if engine == "phd_gaussian" else ["accuracy"]
    assert advised == [*accuracy, *of_particles, "lag"]
    assert set(advised) <= {parameter.name for parameter in TOP}


@pytest.mark.parametrize(("wall_s", "level"), [(2.0, WARN), (0.02, OK)])
def test_tracker_that_is_always_busy_warns_unless_a_replay_waits_for_it(wall_s, level):
    """Where the middleware does not number messages, losses cannot be counted."""
    found = step_status(stepping(19.0, wall_s=wall_s), busy=0.97)
    assert found.level == level
    assert ("busy for 97% of the time" in found.message) == (level == WARN)


def test_refused_subscription_is_a_warning_for_a_while():
    outputs = OutputHealth()
    assert outputs.status("/tracker", 0.0).level == OK
    outputs.refused["/tracker/markers"] += 2
    found = outputs.status("/tracker", 51.0)
    assert found.level == WARN
    assert diagnostics.values_of(found) == {"incompatible_qos /tracker/markers": "2"}
    assert outputs.status("/tracker", 51.0 + WARNING_MEMORY_S).level == OK


def test_checkpoint_that_is_not_written_is_an_error_of_the_outputs():
    outputs = OutputHealth()
    outputs.refused["/tracker/markers"] += 1
    found = outputs.status("/tracker", 51.0, "no checkpoint: /x: a pipe is there")
    assert (found.level, found.message) == (ERROR, "no checkpoint: /x: a pipe is there")


def test_rises_are_of_recent_counts_since_they_began_again():
    rises = Rises()
    assert [rises.recent("lost", count, 100.0 + count) for count in (0, 3, 5)] == [0, 3, 5]
    assert rises.recent("lost", 5, 104.0 + WARNING_MEMORY_S) == 2
    assert rises.recent("other", 0, 104.0) == 0
    rises = Rises()
    assert [rises.recent("plots", count, 100.0) for count in (5, 0, 2)] == [5, 0, 2]
    rises = Rises()
    found = [rises.unchanged_s("plots", count, now) for count, now in ((0, 9), (4, 10), (4, 13))]
    assert found == [math.inf, 0.0, 3.0]


def test_every_subject_is_throttled_by_itself():
    said, now = [], [0.0]
    warnings = ThrottledWarnings(SimpleNamespace(warning=said.append), lambda: now[0])
    for second in range(8):
        now[0] = float(second)
        for radar in ("north", "south"):
            warnings.warn((radar, "late"), f"{radar} at {second}")
    assert said == ["north at 0", "south at 0", "north at 5", "south at 5"]


def test_load_is_the_share_of_the_window_that_was_worked():
    load = Load(10.0)
    assert load.share(100.0) == 0.0
    load.add(100.0, 101.0)
    load.add(104.0, 106.0)
    assert load.share(106.0) == pytest.approx(0.3)
    assert load.worked_s == 3.0
    load = Load(10.0)
    load.add(100.0, 104.0)
    assert load.share(112.0) == pytest.approx(0.2)
    assert load.share(114.0) == 0.0
    assert load.worked_s == 4.0
    load = Load(10.0)
    load.add(100.0, 130.0)
    assert load.share(130.0) == 1.0
