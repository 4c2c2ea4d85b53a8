from dataclasses import replace

import numpy as np
import pytest
from bag_content import recorded, write
from estimate_sets import of_tracks
from reference import resolve

from msg_adapters.encoding import names
from msg_adapters.targets import estimates
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED
from phd_jdtc_ros.parameter_files import bag_parameters

REGIONS = {"west": [-100e3, -100e3, 0.0, 100e3], "east": [0.0, -100e3, 100e3, 100e3]}
MARGIN, SPEED, LAG = 10e3, 250.0, 3
STAMPS = range(1000, 1120, 4)


def x_at(stamp):
    """Return where the aircraft is that flies east."""
    return SPEED * (stamp - 1060)


def tracks(stamp, lag, rows):
    """Return estimates of (number, x, y) that fly east."""
    return of_tracks(
        {number: place for number, *place in rows},
        (SPEED, 0.0),
        (2500.0, 25.0, 2500.0, 25.0, 1e-6),
        stamp_ns=stamp * 10**9,
        lag=lag,
        class_probability=np.tile([1.0, 0.0], (len(rows), 1)),
    )


def bag(directory, tracker, region=True):
    """Write a tracker's estimates of an aircraft that crosses, and one that stays in the west."""
    given = {"region": [*REGIONS[tracker], MARGIN]} if region else {}
    found = []
    for stamp in STAMPS:
        x = x_at(stamp)
        rows = [(9, -50e3, 20e3)] if tracker == "west" else []
        if (tracker == "west" and x < MARGIN) or (tracker == "east" and x > 2e3 - MARGIN):
            rows.append((4 if tracker == "west" else 1, x + (20.0 if rows else 0.0), 0.0))
        found.append((stamp, rows))
    entries = [
        (names.estimates(source), estimates.to_msg(tracks(stamp, lag, rows), "map"), stamp * 10**9)
        for source, lag in ((FILTERED, 0), (SMOOTHED, LAG))
        for stamp, rows in found
    ]
    write(directory, map(names.estimates, (FILTERED, SMOOTHED)), entries)
    bag_parameters.write(directory / bag_parameters.NAME, resolve(given).values)
    return str(directory)


@pytest.fixture
def both(tmp_path):
    return [bag(tmp_path / tracker, tracker) for tracker in REGIONS]


def test_hand_over_keeps_the_number_of_what_crosses_the_seam(both, tmp_path, capsys):
    out = tmp_path / "joint"
    assert run("hand_over", [*both, "--out", str(out)]) == 0
    assert "30 filtered and 30 smoothed stamps of 2 trackers, 2 tracks" in capsys.readouterr().out
    numbers = {}
    for source in (FILTERED, SMOOTHED):
        found = recorded(out, source)
        assert [own.stamp_ns // 10**9 for own in found] == list(STAMPS)
        for own in found:
            order = np.argsort(own.position[:, 1])
            x = own.position[order, 0]
            assert len(own) == 2
            assert abs(x[0] - x_at(own.stamp_ns // 10**9)) <= 20.0
            assert x[1] == pytest.approx(-50e3)
            numbers.setdefault(source, set()).add(tuple(own.track_id[order].tolist()))
    assert numbers[FILTERED] == numbers[SMOOTHED]
    assert len(numbers[FILTERED]) == 1
    assert resolve(bag_parameters.read(out)).values["region"] == []
    # Equal bags give equal bytes.
    again = tmp_path / "again" / "joint"
    assert run("hand_over", [*both, "--out", str(again)]) == 0
    assert (again / "joint_0.mcap").read_bytes() == (out / "joint_0.mcap").read_bytes()


def test_a_stamp_that_one_tracker_lacks_is_that_of_the_other(both, tmp_path):
    topic, own = names.estimates(FILTERED), tracks(1004, 0, [(1, 30e3, 0.0)])
    entries = [(topic, estimates.to_msg(own, "map"), own.stamp_ns)]
    short = write(tmp_path / "short", [topic], entries)
    values = resolve({"region": [*REGIONS["east"], MARGIN]}).values
    bag_parameters.write(short / bag_parameters.NAME, values)
    out = tmp_path / "joint"
    assert run("hand_over", [both[0], str(short), "--out", str(out)]) == 0
    assert [len(own) for own in recorded(out, FILTERED)][:3] == [2, 3, 2]


def test_what_cannot_be_joined_is_reported(both, tmp_path, capsys):
    out, whole = str(tmp_path / "joint"), bag(tmp_path / "whole", "west", region=False)
    bare = write(tmp_path / "bare", [names.estimates(FILTERED)], [])
    for arguments, words in (
        ([both[0], "--out", out], "hand_over: BAG: one given, must be two or more"),
        ([both[0], whole, "--out", out], "region: not set in"),
        ([both[0], str(tmp_path / "none"), "--out", out], "none: no such bag"),
        ([both[0], str(bare), "--out", out], "bare: has no parameters.yaml beside it"),
        ([*both, "--out", both[0]], "already exists"),
    ):
        assert run("hand_over", arguments) == 2
        assert words in capsys.readouterr().err


def with_parameters(directory, **changes):
    """Change parameters that stand beside a bag."""
    values = {**bag_parameters.read(directory), **changes}
    bag_parameters.write(directory / bag_parameters.NAME, values)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"world_frame": "odom"}, "world_frame: 'odom' given, must be 'map' as in"),
        (
            {"world_origin": [47.0, 8.0, 400.0]},
            "world_origin: [47.0, 8.0, 400.0] given, must be []",
        ),
        ({"region": REGIONS["east"]}, "region: margin 0 given, must be above 0"),
        (
            {"region": [-1e3, 0.0, 9e3, 9e3, MARGIN]},
            "region: [-1000, 0, 9000, 9000] given, must not overlap",
        ),
    ],
)
def test_bags_that_do_not_part_one_area_are_refused(both, tmp_path, capsys, changes, words):
    with_parameters(tmp_path / "east", **changes)
    assert run("hand_over", [*both, "--out", str(tmp_path / "joint")]) == 2
    assert f"hand_over: {both[1]}: {words}" in capsys.readouterr().err
    assert not (tmp_path / "joint").exists()


@pytest.mark.parametrize(
    ("number", "variance", "words"),
    [
        (0, 2500.0, "1 of 1 targets have track_id 0, must be above 0"),
        (3, -0.5, "the covariance of track 3 has a negative eigenvalue"),
    ],
)
def test_estimates_that_do_not_join_are_refused(both, tmp_path, capsys, number, variance, words):
    found = tracks(1004, 0, [(number, 30e3, 0.0)])
    covariance = found.covariance.copy()
    covariance[:, 0, 0] = variance
    message = estimates.to_msg(replace(found, covariance=covariance), "map")
    topic = names.estimates(FILTERED)
    wrong = write(tmp_path / "wrong", [topic], [(topic, message, found.stamp_ns)])
    bag_parameters.write(wrong / bag_parameters.NAME, bag_parameters.read(tmp_path / "east"))
    assert run("hand_over", [both[0], str(wrong), "--out", str(tmp_path / "joint")]) == 2
    where = f"hand_over: {wrong}: /tracker/filtered/estimates at 1004.000 s: "
    assert capsys.readouterr().err.startswith(where + words)
