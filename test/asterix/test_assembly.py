# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

import math
import random

import asterix_records as made
import pytest

from phd_jdtc_ros.asterix.assembly import MAX_PENDING, Assembler
from phd_jdtc_ros.asterix.messages import DAY, NORTH, SECTOR, Plot, ServiceMessage

NS = 10**9
ROTATION_S = 4.0


def plot(azimuth_deg, number=0):
    azimuth = math.radians(azimuth_deg % 360.0)
    return Plot(1, 0, DAY, 1000.0 + number, azimuth, 0.0, 0, 0, 1, math.nan, math.nan)


def crossing(azimuth_deg, kind=SECTOR, rotation_s=math.nan):
    # As eight bits say it.
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


def test_every_sector_is_reported_once_and_empty_ones_too():
    found = fed(Assembler(32), *crossings(0.0, 720.0))
    assert [report.sector for report in found] == [*range(32), *range(32)]
    assert [report.stamp_ns for report in found] == [at(11.25 * k) for k in range(1, 65)]
    assert not any(report.plots for report in found)


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
        # An eighth of the bits of a turn is no whole number of those of 12 sectors.
        assert report.stamp_ns == pytest.approx(at((k + 1) * 360.0 / own), abs=0.01 * NS)
        sectors = [int(p.azimuth / (2.0 * math.pi) * own) for p in report.plots]
        assert set(sectors) <= {report.sector}
    assert sum(len(report.plots) for report in found) == 72


def test_north_mark_and_crossing_of_north_are_one():
    events = crossings(0.0, 720.0)
    marks = [(turned, crossing(0.0, NORTH)) for turned in (0.0, 360.0, 720.0)]
    both = sorted([*events, *marks], key=lambda event: event[0])
    assert fed(Assembler(32), *both) == fed(Assembler(32), *events)


def test_north_marks_alone_are_enough():
    seen = [(float(azimuth), plot(azimuth)) for azimuth in range(1, 1080, 20)]
    marks = [(turned, crossing(0.0, NORTH)) for turned in (0.0, 360.0, 720.0, 1080.0)]
    events = sorted([*seen, *marks], key=lambda event: event[0])
    found = fed(Assembler(32, ROTATION_S), *events)
    # One turn before its mark has begun with the first.
    assert [report.sector for report in found] == [*range(32)] * 3
    assert sum(len(report.plots) for report in found) == len(seen)


def test_crossings_that_are_lost_are_bridged():
    events = crossings(0.0, 720.0)
    kept = [event for k, event in enumerate(events) if k not in (3, 4, 30, 31, 32, 40)]
    lossy = Assembler(32)
    found = fed(lossy, *kept)
    assert [report.sector for report in found] == [*range(32), *range(32)]
    stamps = [report.stamp_ns for report in found]
    assert stamps == pytest.approx([at(11.25 * k) for k in range(1, 65)], abs=NS // 100)
    assert lossy.counts["sectors_bridged"] == 6


def test_late_plots_go_with_the_next_sector_or_are_waited_for():
    events = crossings(0.0, 90.0)
    events.insert(3, (23.0, plot(5.0)))  # when two more sectors have been passed
    eager, patient = Assembler(32), Assembler(32, hold=2)
    assert [len(report.plots) for report in fed(eager, *events)][:3] == [0, 0, 1]
    assert eager.counts["late_plots"] == 1
    found = fed(patient, *events)
    assert [len(report.plots) for report in found][:3] == [1, 0, 0]
    assert [(r.sector, r.stamp_ns) for r in found] == [(k, at(11.25 * (k + 1))) for k in range(6)]
    assert patient.counts["late_plots"] == 0


def test_after_a_long_gap_the_turns_are_not_invented():
    assembler = Assembler(32, ROTATION_S)
    fed(assembler, *crossings(0.0, 90.0))
    assert fed(assembler, (3600.0 + 90.0, crossing(90.0))) == []
    assert assembler.counts["turns_lost"] == 1
    assert [r.sector for r in fed(assembler, (3701.25, crossing(101.25)))] == [8]


def test_rotation_is_what_the_radar_says():
    assembler = Assembler(32)
    fed(assembler, (0.0, crossing(0.0, NORTH, rotation_s=4.0)), *crossings(11.25, 360.0))
    assert assembler.rotation_s == 4.0
    assert assembler.observed_turn_s == pytest.approx(4.0)


def test_without_service_messages_the_plots_say_where_the_antenna_is():
    assembler = Assembler(16, ROTATION_S)
    rng = random.Random(1)
    turned = sorted(rng.uniform(0.0, 3600.0) for _ in range(900))
    # Nothing is seen in the west.
    seen = [(t, plot(t)) for t in turned if not 200.0 < t % 360.0 < 300.0]
    # They come out of order, by less than a sector.
    arrived = sorted(seen, key=lambda event: event[0] + rng.uniform(0.0, 20.0))
    found = fed(assembler, *arrived)
    sectors = [report.sector for report in found]
    begin = sectors[0]
    assert sectors == [(begin + k) % 16 for k in range(len(sectors))]
    assert len(sectors) > 16 * 7
    for report in found[8:]:
        inside = {int(p.azimuth / (2.0 * math.pi) * 16) for p in report.plots}
        assert inside <= {report.sector}
    assert assembler.counts["late_plots"] == 0


def test_without_rotation_and_service_messages_clouds_are_by_time():
    assembler = Assembler(32, period_s=1.0)
    found = fed(assembler, *((k * 9.0, plot(k * 9.0)) for k in range(101)))
    assert {report.sector for report in found} == {None}
    assert [len(report.plots) for report in found] == [11, *[10] * 9]
    assert len(assembler.finish()) == 0


def test_clouds_by_time_go_on_where_times_go_back():
    assembler = Assembler(32, period_s=1.0)
    later = fed(assembler, *((k * 9.0, plot(k * 9.0)) for k in range(10_000, 10_041)))
    assert len(later) == 4
    found = fed(assembler, *((k * 9.0, plot(k * 9.0)) for k in range(41)))
    assert [len(report.plots) for report in found] == [11, 10, 10, 10]
    assert [report.stamp_ns for report in found] == [at(90.0 * k) for k in range(1, 5)]


def test_antenna_is_followed_by_plots_where_times_go_back_at_the_start():
    assembler = Assembler(16, ROTATION_S)
    fed(assembler, (36_000.0, plot(0.0)))
    found = fed(assembler, *((k * 9.0, plot(k * 9.0)) for k in range(201)))
    assert len(found) > 16 * 2


def test_service_messages_that_begin_later_take_over():
    assembler = Assembler(32, ROTATION_S)
    plots = [(float(k), plot(k)) for k in range(0, 1800, 7)]
    events = sorted([*plots, *crossings(1080.0, 1800.0)], key=lambda event: event[0])
    found = fed(assembler, *events)
    last = [report for report in found if report.stamp_ns > at(1080.0)]
    assert [r.sector for r in last] == [*range(32), *range(32)]
    assert [r.stamp_ns for r in last] == [at(1080.0 + 11.25 * k) for k in range(1, 65)]


def test_pending_plots_are_bounded():
    assembler = Assembler(32)
    fed(assembler, (0.0, crossing(0.0)), *((1.0, plot(1.0)) for _ in range(MAX_PENDING + 10)))
    assert assembler.counts["overflow"] == 10
    assert len(fed(assembler, (11.25, crossing(11.25)))[0].plots) == MAX_PENDING


def test_stamps_rise_where_times_stand_still():
    assembler = Assembler(32)
    stamps = []
    for k in range(5):
        stamps += [r.stamp_ns for r in assembler.add_service(crossing(11.25 * k), 7 * NS)]
    assert stamps == sorted(set(stamps))


def test_made_turns_are_as_expected():
    # Guards the recordings of other tests.
    from phd_jdtc_ros.asterix.plot_stream import PlotStream

    stream = PlotStream({})
    found = [
        report for data in made.turns(2, seen=[(100.0, 30.0)]) for _, report in stream.feed(data)
    ]
    assert [report.sector for report in found] == [*range(32), *range(32)]
    assert [report.sector for report in found if report.plots] == [8, 8]
