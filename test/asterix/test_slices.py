import itertools
import random
from collections import Counter

import pytest

from phd_jdtc_ros.asterix import assembly
from phd_jdtc_ros.asterix.assembly import Slicer
from phd_jdtc_ros.asterix.messages import DAY, Plot

NS = 10**9
BEGIN = 1000 * NS


def plot(number=0):
    return Plot(1, 0, DAY, 1000.0 + number, 0.0)


def fed(slicer, times_s):
    """Return the slices of plots of these times, seconds, in this order."""
    found = []
    for number, time_s in enumerate(times_s):
        found += slicer.add(plot(number), BEGIN + round(time_s * NS))
    return found


def times_of(reports):
    return [(time - BEGIN) / NS for report in reports for time in report.times_ns]


@pytest.fixture
def slicer():
    return Slicer(0.0, Counter())


def test_slices_are_of_an_eighth_of_a_revolution_and_no_shorter_than_a_quarter_of_a_second():
    for rotation_s, width_s in ((0.0, 0.25), (1.0, 0.25), (4.0, 0.5), (12.0, 1.5)):
        cut = Slicer(rotation_s, Counter())
        found = fed(cut, [k * 0.05 for k in range(2000)]) + cut.finish()
        stamps = [report.stamp_ns for report in found]
        assert {b - a for a, b in itertools.pairwise(stamps)} == {round(width_s * NS)}


def test_plots_are_in_the_slice_of_their_time_and_keep_it(slicer):
    times = [k * 0.07 for k in range(500)]
    found = fed(slicer, times) + slicer.finish()
    assert times_of(found) == pytest.approx(times)
    for report in found:
        assert all(report.stamp_ns - NS // 4 <= time < report.stamp_ns for time in report.times_ns)
    assert not +slicer.counts


def test_a_slice_without_plots_is_one_but_in_a_silence(slicer):
    found = fed(slicer, [0.0, 0.1, 3.0, 3.1, 30.0, 30.1]) + slicer.finish()
    assert [len(report.plots) for report in found] == [2, *[0] * 11, 2, 2]
    stamps = [(report.stamp_ns - BEGIN) / NS for report in found]
    assert stamps[-2:] == [3.25, 30.25]


@pytest.mark.parametrize("late_s", [0.3, 0.8, 1.9])
def test_plots_that_are_late_all_the_time_are_waited_for(slicer, late_s):
    rng = random.Random(1)
    times = [k * 0.08 for k in range(10_000)]
    arrived = sorted(times, key=lambda time_s: time_s + rng.uniform(0.0, late_s))
    found = fed(slicer, arrived) + slicer.finish()
    assert slicer.counts["late_plots"] == 0
    assert times_of(found) == pytest.approx(times)


def test_slices_are_sent_soon_where_plots_come_in_order(slicer):
    fed(slicer, [k * 0.05 for k in range(3000)])
    (last,) = fed(slicer, [150.0, 150.05, 150.26, 150.27])[-1:]
    assert last.stamp_ns == BEGIN + 150 * NS + NS // 4


def test_plot_that_comes_too_late_goes_with_the_next_slice_and_is_counted(slicer):
    times = [k * 0.05 for k in range(3000)]
    found = fed(slicer, [*times, 140.0, 150.0, 151.0, 151.01]) + slicer.finish()
    assert slicer.counts["late_plots"] == 1
    (late,) = [report for report in found if BEGIN + 140 * NS in report.times_ns[:1]][1:]
    assert late.stamp_ns > BEGIN + 149 * NS
    stamps = [report.stamp_ns for report in found]
    assert stamps == sorted(set(stamps))


@pytest.mark.parametrize("wrong_s", [30.0, 3600.0, -600.0])
def test_one_plot_of_a_wrong_time_disturbs_no_other(slicer, wrong_s):
    times = [k * 0.05 for k in range(3000)]
    arrived = [*times[:1500], 75.0 + wrong_s, *times[1500:]]
    found = fed(slicer, arrived) + slicer.finish()
    assert slicer.counts["late_plots"] == (wrong_s < 0.0)
    assert sorted(times_of(found)) == pytest.approx(sorted(arrived))


def test_slices_go_on_where_times_go_back(slicer):
    times = [k * 0.05 for k in range(3000)]
    later = [3600.0 + time_s for time_s in times]
    found = fed(slicer, [*later, *times]) + slicer.finish()
    # The first one back might have been of a wrong time.
    assert sorted(times_of(found)) == pytest.approx(sorted([*times, *later]))
    assert slicer.counts["late_plots"] <= 1


def test_plots_that_wait_are_bounded(slicer, monkeypatch):
    monkeypatch.setattr(assembly, "MAX_PENDING", 100)
    fed(slicer, [0.0] * 110)
    assert slicer.counts["overflow"] == 10
    assert sum(len(report.plots) for report in slicer.finish()) == 100


def test_one_plot_far_ahead_does_not_silence_a_radar_that_pauses(slicer):
    before = [k * 0.1 for k in range(200)]
    found = fed(slicer, [*before[:100], 3600.0, *before[100:]]) + slicer.finish()
    assert max(report.stamp_ns for report in found) < BEGIN + 25 * NS
    assert sorted(times_of(found)) == pytest.approx(sorted([*before, 3600.0]))
    after = [30.0 + time_s for time_s in before]
    assert times_of(fed(slicer, after) + slicer.finish()) == pytest.approx(after)
    assert slicer.counts["late_plots"] == 0
