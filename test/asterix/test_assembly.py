import math

import numpy as np
import pytest

from phd_jdtc_ros.asterix import assembly
from phd_jdtc_ros.asterix.assembly import LEARNED, Assembler
from phd_jdtc_ros.asterix.messages import DAY, NORTH, SECTOR, Plot, ServiceMessage

NS = 10**9
ROTATION_S = 4.0


def plot(azimuth_deg, number=0):
    return Plot(1, 0, DAY, 1000.0 + number, math.radians(azimuth_deg % 360.0))


def crossing(azimuth_deg, kind=SECTOR, rotation_s=math.nan):
    # The resolution of eight bits.
    azimuth = round(azimuth_deg % 360.0 / 360.0 * 256) % 256 * 2.0 * math.pi / 256
    return ServiceMessage(1, 0, kind, azimuth, rotation_s)


def at(turned_deg, rotation_s=ROTATION_S):
    """Return when the antenna has turned so far, in nanoseconds."""
    return 1000 * NS + round(turned_deg / 360.0 * rotation_s * NS)


def fed(assembler, *events):
    """Return the sectors of events (degrees turned, message)."""
    found = []
    for turned, message in events:
        if isinstance(message, Plot):
            found += assembler.add_plot(message, at(turned))
        else:
            found += assembler.add_service(message, at(turned))
    return found


def crossings(begin, end, step=11.25):
    count = round((end - begin) / step) + 1
    return [(begin + k * step, crossing(begin + k * step)) for k in range(count)]


def test_sectors_follow_crossings_and_north_marks():
    found = fed(Assembler(32), *crossings(0.0, 720.0))
    assert [report.sector for report in found] == [*range(32), *range(32)]
    assert [report.stamp_ns for report in found] == [at(11.25 * k) for k in range(1, 65)]
    assert not any(report.plots for report in found)
    events = crossings(0.0, 720.0)
    marks = [(turned, crossing(0.0, NORTH)) for turned in (0.0, 360.0, 720.0)]
    both = sorted([*events, *marks], key=lambda event: event[0])
    assert fed(Assembler(32), *both) == fed(Assembler(32), *events)


def test_plots_are_in_the_sector_of_their_azimuth():
    events = crossings(0.0, 45.0)
    events[1:1] = [(3.0, plot(3.0)), (12.0, plot(12.0)), (11.0, plot(11.0))]
    found = fed(Assembler(32), *events)
    assert [[round(math.degrees(p.azimuth)) for p in report.plots] for report in found] == [
        [3, 11],
        [12],
        [],
        [],
    ]
    assert found[0].times_ns == [at(3.0), at(11.0)]


@pytest.mark.parametrize(("own", "radars"), [(16, 32), (32, 16), (8, 12), (32, 4)])
def test_sectors_need_not_be_those_of_the_radar(own, radars):
    step = 360.0 / radars
    seen = [(azimuth + 1.0, plot(azimuth + 1.0)) for azimuth in range(0, 720, 10)]
    events = sorted([*crossings(0.0, 720.0, step), *seen], key=lambda event: event[0])
    found = fed(Assembler(own), *events)
    assert [report.sector for report in found] == [*range(own), *range(own)]
    for k, report in enumerate(found):
        # An eighth of the bits of a revolution is no whole number of those of 12 sectors.
        assert report.stamp_ns == pytest.approx(at((k + 1) * 360.0 / own), abs=0.01 * NS)
        sectors = [int(p.azimuth / (2.0 * math.pi) * own) for p in report.plots]
        assert set(sectors) <= {report.sector}
    assert sum(len(report.plots) for report in found) == 72


def test_north_marks_alone_or_ended_crossings_make_slices_of_time():
    seen = [(float(azimuth), plot(azimuth)) for azimuth in range(1, 1080, 20)]
    marks = [(turned, crossing(0.0, NORTH)) for turned in (0.0, 360.0, 720.0, 1080.0)]
    events = sorted([*seen, *marks], key=lambda event: event[0])
    assembler = Assembler(32, ROTATION_S)
    found = fed(assembler, *events) + assembler.finish()
    assert {report.sector for report in found} == {None}
    assert [time for report in found for time in report.times_ns] == [at(t) for t, _ in seen]
    assert (assembler.by_sector, assembler.by_time) == (0, len(found))
    assembler = Assembler(32)
    plots = [(float(k), plot(k)) for k in range(0, 3600, 7)]
    events = sorted([*plots, *crossings(0.0, 1080.0)], key=lambda event: event[0])
    found = fed(assembler, *events) + assembler.finish()
    assert assembler.counts["revolutions_lost"] == 1
    times = [time for report in found for time in report.times_ns]
    assert sorted(times) == [at(turned) for turned, _ in plots]
    assert found[-1].sector is None


@pytest.mark.parametrize("end_deg", [1800.0, 1900.0, 2200.0, 2400.0, 3600.0])
def test_plots_after_ended_crossings_are_in_slices_of_their_time(end_deg):
    assembler = Assembler(32)
    plots = [(float(k), plot(k)) for k in range(0, round(end_deg), 7)]
    events = sorted([*plots, *crossings(0.0, 1800.0)], key=lambda event: event[0])
    found = fed(assembler, *events) + assembler.finish()
    times = [time for report in found for time in report.times_ns]
    assert sorted(times) == [at(turned) for turned, _ in plots]
    stamps = [report.stamp_ns for report in found]
    assert stamps == sorted(set(stamps))
    assert stamps[-1] < at(end_deg) + NS // 2
    assert all(abs(report.stamp_ns - time) <= NS for report in found for time in report.times_ns)


@pytest.mark.parametrize("pause_s", [0.0, 30.0])
@pytest.mark.parametrize(("first_s", "second_s"), [(4.0, 12.0), (12.0, 4.0), (4.0, 4.8)])
def test_a_changed_revolution_is_followed_and_its_parts_are_named(first_s, second_s, pause_s):
    assembler, time_ns, stamps = Assembler(32), 1000 * NS, []
    for k in range(32 * 20 + 1):
        stamps += [r.stamp_ns for r in assembler.add_service(crossing(11.25 * k), time_ns)]
        # It changes in the middle of a revolution.
        time_ns += round((first_s if k < 32 * 10 + 11 else second_s) / 32 * NS)
        time_ns += round(pause_s * NS) if k == 32 * 10 + 11 else 0
    assert assembler.revolution_s == pytest.approx(second_s, rel=1e-3)
    assert assembler.longest_revolution_s == pytest.approx(max(first_s, second_s), rel=1e-3)
    (end_ns, before_s), (_, after_s) = assembler.parts
    assert (before_s, after_s) == pytest.approx((first_s, second_s), rel=1e-3)
    assert 1000 + 9 * first_s <= end_ns / NS <= 1000 + 11 * first_s
    assert stamps == sorted(set(stamps))


def test_a_revolution_that_wind_disturbs_has_one_part():
    rng, assembler, time_ns = np.random.default_rng(3), Assembler(32), 1000 * NS
    for k in range(32 * 30):
        assembler.add_service(crossing(11.25 * k), time_ns)
        time_ns += round(4.0 * (1.0 + 0.03 * np.sin(k / 200.0)) / 32 * NS)
        time_ns += round(0.2 * NS * rng.random()) if k % 97 == 0 else 0
    assert len(assembler.parts) == 1


def test_lost_crossings_are_bridged_and_long_gaps_not_invented():
    events = crossings(0.0, 720.0)
    kept = [event for k, event in enumerate(events) if k not in (3, 4, 30, 31, 32, 40)]
    lossy = Assembler(32)
    found = fed(lossy, *kept)
    assert [report.sector for report in found] == [*range(32), *range(32)]
    stamps = [report.stamp_ns for report in found]
    assert stamps == pytest.approx([at(11.25 * k) for k in range(1, 65)], abs=NS // 100)
    assert lossy.counts["sectors_bridged"] == 6
    assembler = Assembler(32, ROTATION_S)
    fed(assembler, *crossings(0.0, 90.0))
    assert fed(assembler, (3600.0 + 90.0, crossing(90.0))) == []
    assert assembler.counts["revolutions_lost"] == 1
    assert [r.sector for r in fed(assembler, (3701.25, crossing(101.25)))] == [8]


def test_late_plots_go_with_the_next_sector_or_are_waited_for():
    events = crossings(0.0, 90.0)
    events.insert(3, (23.0, plot(5.0)))  # Two more sectors have been passed
    eager, patient = Assembler(32), Assembler(32, hold=2)
    assert [len(report.plots) for report in fed(eager, *events)][:3] == [0, 0, 1]
    assert eager.counts["late_plots"] == 1
    found = fed(patient, *events)
    assert [len(report.plots) for report in found][:3] == [1, 0, 0]
    assert [(r.sector, r.stamp_ns) for r in found] == [(k, at(11.25 * (k + 1))) for k in range(6)]
    assert patient.counts["late_plots"] == 0


def test_revolution_is_the_reported_one_until_crossings_have_shown_half_of_one():
    assembler = Assembler(32, rotation_s=3.9)
    fed(assembler, *crossings(0.0, 360.0))
    assert assembler.revolution_s == pytest.approx(4.0)
    assembler = Assembler(32)
    fed(assembler, (0.0, crossing(0.0, NORTH, rotation_s=4.1)), *crossings(11.25, 90.0))
    assert assembler.revolution_s == 4.1


def test_crossing_that_is_overtaken_by_a_north_mark_adds_no_revolution():
    # The north mark is 0.4 s of a revolution of 4.9 s ahead of the crossings that follow it.
    assembler = Assembler()
    events = [(crossing(315.0), 0.0), (crossing(326.25), 0.15)]
    events += [(crossing(0.0, NORTH, rotation_s=4.9), 0.61)]
    events += [(crossing(337.5), 0.31), (crossing(348.75), 0.46), (crossing(11.25), 0.77)]
    for message, time_s in events:
        assembler.add_service(message, round(time_s * NS))
    assert assembler.revolution_s == 4.9
    assert assembler.counts["sectors_bridged"] < 4


def test_hold_is_as_many_sectors_as_plots_are_late():
    assembler = Assembler(32, hold=LEARNED)
    events = crossings(0.0, 36_000.0)
    # Each comes when the antenna is 25 degrees beyond it, which is in the third sector.
    late = [(azimuth + 25.0, plot(azimuth + 0.1)) for azimuth in range(5, 35_900, 7)]
    events = sorted([*events, *late], key=lambda event: event[0])
    last = crossing(36_011.25)
    found = fed(assembler, *events)
    assert assembler.counts["late_plots"] == 0
    assert all(
        int(p.azimuth / (2.0 * math.pi) * 32) == report.sector
        for report in found
        for p in report.plots
    )
    (closed,) = fed(assembler, (36_011.25, last))
    assert closed.stamp_ns == at(36_011.25 - 3 * 11.25)


def test_plots_that_come_before_their_crossing_are_held_no_longer_after_a_while():
    assembler = Assembler(32, hold=LEARNED)
    seen = [(azimuth + 0.5, plot(azimuth)) for azimuth in range(5, 36_000, 7)]
    # Less than the half degree from a plot to the next crossing is taken for a late one.
    early = [event for event in seen if event[0] % 11.25 > 1.0]
    fed(assembler, *sorted([*crossings(0.0, 36_000.0), *early], key=lambda event: event[0]))
    (closed,) = fed(assembler, (36_011.25, crossing(36_011.25)))
    assert closed.stamp_ns == at(36_011.25)


def test_service_messages_that_begin_later_take_over():
    assembler = Assembler(32, ROTATION_S)
    plots = [(float(k), plot(k)) for k in range(0, 1800, 7)]
    events = sorted([*plots, *crossings(1080.0, 1800.0)], key=lambda event: event[0])
    found = fed(assembler, *events)
    last = [report for report in found if report.sector is not None]
    assert [r.sector for r in last] == [*range(32), *range(32)]
    assert [r.stamp_ns for r in last] == [at(1080.0 + 11.25 * k) for k in range(1, 65)]
    assert sum(len(r.plots) for r in found) == len(plots)


def test_one_plot_of_a_wrong_time_does_not_end_the_sectors():
    assembler = Assembler(32)
    events = crossings(0.0, 720.0)
    events.insert(40, (3600.0, plot(400.0)))
    found = fed(assembler, *events)
    assert [report.sector for report in found] == [*range(32), *range(32)]
    assert assembler.counts["revolutions_lost"] == 0


def test_pending_plots_are_bounded(monkeypatch):
    monkeypatch.setattr(assembly, "MAX_PENDING", 100)
    assembler = Assembler(32)
    fed(assembler, *crossings(0.0, 11.25), *[(12.0, plot(12.0))] * 110)
    assert assembler.counts["overflow"] == 10
    (sector,) = fed(assembler, (22.5, crossing(22.5)))
    assert len(sector.plots) == 100


def test_stamps_rise_where_times_stand_still():
    assembler = Assembler(32)
    stamps = []
    for k in range(5):
        stamps += [r.stamp_ns for r in assembler.add_service(crossing(11.25 * k), 7 * NS)]
    assert stamps == sorted(set(stamps))
