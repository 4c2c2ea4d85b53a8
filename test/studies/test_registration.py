"""The study of registration, smaller: its figures, goals and summary."""

from dataclasses import replace

import biased
import pytest
from rich.console import Console

from phd_jdtc_ros.core.sensors.bias import NO_BIAS
from studies import registration
from studies.registration import BIASED, CORRECTED, RUNS, UNBIASED, Row
from studies.runner import until

# The tracker runs for so long.
TRACKED_S = 80.0


@pytest.fixture(scope="module")
def found():
    document = biased.document()
    # Without a lag and most of the clutter the tracker needs a tenth of the time.
    document["parameters"] |= {"lag": 0}
    for name in ("west", "east", "south"):
        document["parameters"][name]["clutter_rate"] = 1.0
    return registration.run(document, 7, None, TRACKED_S)


def test_the_tracker_gains_by_what_is_found(found):
    errors = found["rms_m"]
    assert tuple(errors) == RUNS
    for source in ("filtered", "smoothed"):
        assert errors[BIASED][source] > 1.2 * errors[UNBIASED][source]
        assert errors[CORRECTED][source] < 1.1 * errors[UNBIASED][source]
    rows = {(row["radar"], row["error"]): row for row in found["errors"]}
    azimuth = rows["east", "azimuth, clockwise"]
    assert azimuth["true"] == pytest.approx(0.3)
    assert azimuth["found"] == pytest.approx(0.3, abs=0.05)
    assert rows["east", "time offset"]["true"] == 0.5
    assert rows["south", "range bias"]["true"] == 0.0


def test_the_tables_show_every_error_and_run(found):
    console = Console(record=True, width=120)
    for table in registration.tables(found):
        console.print(table)
    text = console.export_text()
    assert text.count("east") == text.count("south") == 4
    assert text.count("reference") == 1
    for name in RUNS:
        assert name in text


def test_goals_are_of_the_radar_that_is_worst():
    rows = [
        Row("one", "range bias", "m", 80.0, 85.0, 2.0),
        Row("two", "range bias", "m", 0.0, -9.0, 2.0),
        Row("one", "azimuth, clockwise", "deg", 0.3, 0.31, 0.01),
        Row("one", "time offset", "s", 0.5, 0.52, 0.01),
    ]
    errors = {
        UNBIASED: {"filtered": 50.0, "smoothed": 30.0},
        CORRECTED: {"filtered": 52.0, "smoothed": 33.0},
    }
    goals = {goal["name"]: goal for goal in registration.goals_of(rows, errors)}
    assert len(goals) == 5
    assert all(name.startswith("registration: ") for name in goals)
    of_range = goals["registration: range bias, m"]
    assert (of_range["value"], of_range["goal"], of_range["reached"]) == (9.0, 8.0, False)
    assert goals["registration: azimuth, clockwise, deg"]["reached"]
    assert goals["registration: time offset, s"]["goal"] == 0.05
    assert goals["registration: RMS filtered, to no errors"]["reached"]
    assert not goals["registration: RMS smoothed, to no errors"]["reached"]


def test_a_part_of_a_scenario_has_the_targets_until_then():
    _, scene = biased.scene(biased.document(scans=1201))
    part = until(scene, 60.0)
    assert part.duration_s == 60.0
    starts = [flight.start_s for flight in part.flights]
    assert max(starts) <= 60.0
    assert len(starts) < len(scene.flights)
    assert part.bias(1) == scene.bias(1) != NO_BIAS
    assert replace(scene, biases=()).bias(1) == NO_BIAS
