import json
import time
from dataclasses import replace

import numpy as np
import pytest

from phd_jdtc_ros import __main__ as executables
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, Estimates
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.exit_status import FAILED, OK, USAGE
from phd_jdtc_ros.simulation.scenario import truth_after
from phd_jdtc_ros.simulation.transponder import Transponders
from studies.command import main
from studies.hours import hour as hours
from studies.hours import study
from studies.hours.goals import AS_IS, NO_IDENTITIES, TUNED, WAYS, goals_of
from studies.hours.hour import FOUND_M, Hour, Reader, Scores
from studies.hours.study import hour_of

SHORT = ["--minutes", "2", "--hour", "en_route_hour"]


@pytest.fixture(scope="module")
def hour():
    return hour_of("approach_hour", 8.0, 0)[0]


@pytest.fixture(scope="module")
def reader(hour):
    return Reader(hour.layout, hour.scenario.radars[0])


@pytest.fixture(scope="module")
def true_tracks(hour, reader):
    """Return the targets of every revolution as tracks, also those that taxi or are unseen."""
    found = []
    for end_s in hour.ends_s.tolist():
        truth, position = hour.truth(end_s, reader)
        found.append(PointSet(position, truth.class_id, truth.track_id + 100, truth.velocity))
    return found


def scored(hour, reader, found):
    return hours.scores(hour, reader, hour.ends_s, found)


def test_true_tracks_are_found_and_none_without_tracks(hour, reader, true_tracks):
    found = scored(hour, reader, true_tracks)
    assert found.instants > 3000
    assert (found.found, found.found_from_first, found.rms) == (1.0, 1.0, 0.0)
    assert (found.false_a_revolution, found.switches, found.renumbered) == (0.0, 0, 0)
    assert found.returned > 0
    none = [points.only(np.zeros(0, np.int64)) for points in true_tracks]
    found = scored(hour, reader, none)
    assert (found.found, found.rms, found.false_a_revolution) == (0.0, FOUND_M, 0.0)


def test_intervals_are_of_the_differences_between_parts_of_the_hour(hour, reader, true_tracks):
    parts = np.array_split(np.arange(len(true_tracks)), hours.BLOCKS)
    half = [
        points.only(np.arange(len(points) if revolution < parts[6][0] else 0))
        for revolution, points in enumerate(true_tracks)
    ]

    assert scored(hour, reader, true_tracks).half_width["found"] == 0.0
    # Six parts have all targets and six none: the 97.5 % quantile of Student's t of 11 degrees of
    # freedom, 2.201, times the standard error of their mean.
    expected = 2.201 * np.std([0.0, 1.0] * 6, ddof=1) / np.sqrt(12)
    assert scored(hour, reader, half).half_width["found"] == pytest.approx(expected, rel=1e-3)


def test_slow_targets_and_those_out_of_sight_are_not_missed(hour, reader, true_tracks):
    # Without tracks of what taxis, and of targets in the middle of their gaps.
    rest = []
    for end_s, points in zip(hour.ends_s.tolist(), true_tracks, strict=True):
        truth = truth_after(hour.scenario, end_s)
        kept = np.hypot(*truth.velocity.T) > 40.0
        for gap in hour.scenario.gaps:
            inside = gap.start_s + 8.0 < end_s < gap.end_s
            kept &= ~((truth.track_id == gap.number) & inside)
        rest.append(points.only(np.flatnonzero(kept)))
    assert sum(map(len, rest)) < sum(map(len, true_tracks))
    assert scored(hour, reader, rest).found == 1.0


def test_errors_are_distances_and_far_tracks_are_missed_and_false(hour, reader, true_tracks):
    near = [
        replace(points, position=points.position + np.array([30.0, 40.0])) for points in true_tracks
    ]
    assert scored(hour, reader, near).rms == pytest.approx(50.0)
    far = [replace(points, position=points.position + np.array([0.0, 3e6])) for points in near]
    found = scored(hour, reader, far)
    assert found.found == 0.0
    assert found.false_a_revolution == pytest.approx(np.mean([len(points) for points in far]))


def test_changed_numbers_are_switches_or_renumbered_after_a_gap(hour, reader, true_tracks):
    middle = len(true_tracks) // 2
    (end_s,) = hour.ends_s[[middle]].tolist()
    now = true_tracks[middle]
    speed = dict(zip(now.track_id.tolist(), np.hypot(*now.velocity.T).tolist(), strict=True))
    seen = [number for number in speed if hour.passes(number - 100, end_s) > 50]
    # Who taxis is not scored.
    for number, switches in ((max(seen, key=speed.get), 1), (min(seen, key=speed.get), 0)):
        swapped = [_renamed(each, number, 7000, k > middle) for k, each in enumerate(true_tracks)]
        found = scored(hour, reader, swapped)
        assert (found.switches, found.renumbered) == (switches, 0)
    numbers = [gap.number for gap in hour.scenario.gaps if gap.end_s < 440.0]
    gap = next(each for each in hour.scenario.gaps if each.number == numbers[0])
    later = [
        _renamed(points, gap.number + 100, 7001, end > gap.start_s + 5.0)
        for end, points in zip(hour.ends_s.tolist(), true_tracks, strict=True)
    ]
    found = scored(hour, reader, later)
    assert (found.switches, found.renumbered) == (0, 1)


def _renamed(points, number, other, now):
    renamed = np.where((points.track_id == number) & now, other, points.track_id)
    return replace(points, track_id=renamed)


def test_passes_count_from_when_a_target_came_into_sight(hour):
    gap = next(each for each in hour.scenario.gaps if each.end_s < 440.0)
    assert hour.passes(gap.number, gap.start_s - 5.0) > 3
    assert hour.passes(gap.number, gap.start_s + 0.1) == 0
    assert hour.passes(gap.number, gap.end_s - 0.1) == 0
    after = [
        hour.passes(gap.number, gap.end_s + 4.0016 * revolutions)
        for revolutions in (1.05, 2.05, 3.05)
    ]
    assert after == [1, 2, 3]
    assert hour.passes(10_000, 100.0) == 0


def test_shift_is_found_whatever_is_missing():
    rng = np.random.default_rng(5)
    own = np.sort(rng.uniform(0.0, 600.0, 4000))
    recorded = np.round(own * 128.0) / 128.0 + 1581.3
    kept = recorded[(rng.random(4000) < 0.3) & (recorded > 1581.3 + 200.0)]
    assert hours.shift_s(own, kept) == pytest.approx(1581.3, abs=5e-3)


def test_tracks_are_those_nearest_to_the_end_of_each_revolution(hour):
    def estimates(time_s):
        return Estimates(
            hour.scenario.start_ns + round((time_s + 5.0) * 1e9),
            *(0, np.zeros((1, 5)), np.zeros((1, 5, 5)), np.ones(1), np.ones((1, 1))),
            *(np.zeros(1, np.int64), np.ones(1, np.int64)),
        )

    ends = hour.ends_s
    made = [estimates(ends[0] + 1.0), estimates(ends[0] - 0.5), estimates(ends[2] + 1.9)]
    times_s, found = hours.tracks(hour, made, 5.0)
    np.testing.assert_allclose(times_s[:4], [ends[0] - 0.5, ends[1], ends[2] + 1.9, ends[3]])
    assert [len(points) for points in found[:4]] == [1, 0, 1, 0]


def test_truth_is_where_a_flat_earth_puts_it(hour, reader):
    flat = replace(hour.layout, site=None, datum=0.0)
    own = Reader(flat, replace(reader.radar, position=(500.0, -200.0)))
    truth, position = hour.truth(300.0, own)
    _, there = hour.truth(300.0, reader)
    np.testing.assert_allclose(there, truth.position, atol=0.01)
    off = np.hypot(*(position - [500.0, -200.0] - truth.position).T)
    # The projections differ by some 30 m at 105 km, and not at the origin.
    assert 5.0 < off.max() < 80.0
    assert off[np.hypot(*truth.position.T) < 10e3].max() < 5.0


def test_truth_that_answers_nothing_is_where_its_plots_are(hour, reader):
    silent = Hour(
        replace(hour.scenario, transponders=Transponders(share=0.0)), hour.layout, hour.seed
    )
    truth, position = silent.truth(300.0, reader)
    off = np.hypot(*position.T) - np.hypot(*truth.position.T)
    # The antenna's height is supposed: what is higher seems farther away.
    assert 100.0 < off.max() < 5000.0
    assert off.min() > -50.0


def test_plot_kalman_gets_the_same_plots_and_finds_aircraft(hour, reader):
    found = scored(hour, reader, hours.plot_kalman(hour, reader, hour.ends_s))
    assert found.found > 0.98
    assert 10.0 < found.rms < 100.0


def tracked(found, rms, false=0.1, switches=2, status=0):
    own = Scores(1000, found, found, rms, false, switches, 0, 0)
    peer = Scores(1000, 0.99, 0.99, 40.0, 0.5, 10, 0, 0)
    smoothed = own._replace(rms=0.5 * rms)
    scores = {FILTERED: own._asdict(), SMOOTHED: smoothed._asdict()}
    return {"status": status, "scores": scores, "plot_kalman": peer._asdict()}


def reached(ways, hour="approach_hour"):
    goals = goals_of(hour, ways)
    assert len({goal["name"] for goal in goals}) == len(goals)
    return {goal["name"].removeprefix(f"{hour}: "): goal["reached"] for goal in goals}


def test_goals_compare_tracks_with_the_plot_kalman_tracker():
    good = {
        AS_IS: tracked(0.999, 30.0, switches=1),
        NO_IDENTITIES: tracked(0.999, 30.0, switches=10),
        TUNED: tracked(0.999, 30.0),
    }
    assert all(reached(good).values())
    worse = {**good, AS_IS: tracked(0.985, 33.0, 0.31, 11, status=3)}
    missed = {name for name, whole in reached(worse).items() if not whole}
    assert missed == {
        "exit status, nothing set",
        "found filtered, %, nothing set",
        "found smoothed, %, nothing set",
        "RMS filtered, to plot Kalman, nothing set",
        "RMS smoothed, to plot Kalman, nothing set",
        "false tracks a turn",
        "identity switches with identities",
        "identity switches with addresses",
    }
    assert not reached({**good, NO_IDENTITIES: tracked(0.999, 30.0, switches=11)})[
        "identity switches without identities"
    ]
    assert "identity switches with addresses" not in reached(good, "en_route_hour")


def test_goals_without_tracks_are_the_exit_statuses():
    assert reached({AS_IS: {"status": 2, "scores": {}, "plot_kalman": None}}) == {
        "exit status, nothing set": False
    }


def run_here(name, *arguments):
    """Run an executable in this process, which has loaded all of them."""
    begin = time.process_time()
    status = executables.run(name, [*map(str, arguments)])
    return study.Run(status, time.process_time() - begin, "")


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Return the exit status of the study of some minutes, and its directories."""
    place = tmp_path_factory.mktemp("hours")
    out, kept = place / "out", place / "kept"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "run", run_here)
        status = main(["hours", *SHORT, "--out", str(out), "--keep", str(kept)])
    return status, out, kept


def test_hours_writes_figures_and_goals(ran):
    status, out, kept = ran
    assert status == OK
    found = json.loads((out / "hours.json").read_text())
    ways = found["hours"]["en_route_hour"]
    assert set(ways) == set(WAYS)
    for each in ways.values():
        assert each["cpu_s"] > 0.0
        assert set(each["scores"]) == {"filtered", "smoothed"}
        assert each["plot_kalman"]["instants"] > 100
    assert json.loads((out / "summary.json").read_text())["goals"] == found["goals"]
    assert (kept / "en_route_hour" / "recording.pcap").stat().st_size > 10_000


def test_hours_scores_a_bag_as_the_study_did(ran, capsys):
    _, out, kept = ran
    tracked = kept / "en_route_hour" / "out"
    assert main(["hour_of_bag", str(tracked), *SHORT, "--out", str(out)]) == OK
    shown = capsys.readouterr().out
    peer = json.loads((out / "hours.json").read_text())
    peer = peer["hours"]["en_route_hour"]["nothing set"]["plot_kalman"]
    assert f"{100.0 * peer['found']:.2f}" in shown
    assert f"{peer['rms']:.1f}" in shown


def test_hours_fails_where_a_recording_gives_no_tracks(tmp_path, monkeypatch):
    def nothing(hour, config, document, path):
        path.write_bytes(b"no ASTERIX")

    monkeypatch.setattr(study, "record", nothing)
    out = tmp_path / "out"
    assert main(["hours", *SHORT, "--out", str(out)]) == FAILED
    (goal,) = json.loads((out / "hours.json").read_text())["goals"]
    assert (goal["name"], goal["reached"]) == ("en_route_hour: exit status, nothing set", False)


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        (["--seed", "-1"], "--seed: -1 given"),
        (["--minutes", "1"], "--minutes: 1.0 given, must be at least 2"),
        (["--keep", "."], "already exists"),
    ],
)
def test_hours_names_what_is_wrong(given, fault, capsys):
    assert main(["hours", *SHORT[2:], *given]) == USAGE
    assert fault in capsys.readouterr().err
