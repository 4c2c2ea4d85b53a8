"""Where there are maps of clutter, tracks at rest are not reported."""

from dataclasses import replace

import numpy as np
import pytest
from inner import resolve
from track_inputs import estimates_of, scan_of

from phd_jdtc_ros.core.tracks.confirmation import TrackStates
from phd_jdtc_ros.core.tracks.reporting_rule import rule_of

SECOND = 1_000_000_000
# One radar with a map of clutter; targets are born at detections, at up to 10 m/s.
COAST = {
    "sensors": ["mast"],
    "births": [],
    "interval_s": 2.5,
    "detection_births.rates": [0.02, 0.02],
    "detection_births.velocity_std": 5.0,
    "mast.clutter_map": True,
    "mast.clutter_rate": 1.0,
    "mast.clutter_map_speed": 2.5,
}


def moving(states, model, stamp_ns, speed, std):
    """Return the state of a certain track with such a velocity, if it is reported."""
    found = estimates_of(stamp_ns, {1: 0.999}, model=model)
    state, covariance = found.state.copy(), found.covariance.copy()
    axes = list(model.modes.space.velocity)
    state[:, axes] = [speed, 0.0]
    covariance[:, axes, axes] = std**2
    found = replace(found, state=state, covariance=covariance)
    reported = states.report_filtered(found, np.array([0]), [], scan_of(stamp_ns, model), model)
    return reported.track_state.tolist()


# Unknown, moving, unknown again, at rest, moving again.
VELOCITIES = [(0.0, 5.0), (6.0, 2.0), (2.5, 4.0), (0.3, 0.5), (4.0, 0.5)]


def states_by_scan(model):
    """Return whether a track with these velocities is reported, scan by scan."""
    states = TrackStates(rule_of(model, True))
    return [
        bool(moving(states, model, (index + 1) * SECOND, *velocity))
        for index, velocity in enumerate(VELOCITIES)
    ]


def with_answers(model, answers):
    """Return the model with a map of a quay at 5 km, of reflectors that answer every turn."""
    (radar,) = model.radars
    places = radar.clutter_map
    azimuth = 2.0 * np.pi / places.grid.columns * (4 + np.arange(answers))
    seen = np.stack([np.full(answers, 5e3), azimuth], axis=1)
    for _ in range(4):
        places = places.after(seen, radar.to_world(seen), np.ones(answers), 1.0)
    return replace(model, radars=(replace(radar, clutter_map=places),))


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, [True, True, True, False, True]),
        ({"mast.clutter_map": False}, [True] * 5),
        ({"mast.clutter_map_speed": 0.0}, [True] * 5),
    ],
)
def test_where_there_is_a_map_of_clutter_tracks_at_rest_are_not_reported(given, expected):
    assert states_by_scan(resolve({**COAST, **given}).model) == expected


@pytest.mark.parametrize(
    ("given", "expected"),
    [({}, [False, True, False, False, True]), ({"mast.clutter_map_speed": 0.0}, [True] * 5)],
)
def test_among_reflectors_only_tracks_in_evident_motion_are_reported(given, expected):
    model = resolve({**COAST, **given}).model
    assert states_by_scan(with_answers(model, 5)) == expected
    # One reply beside it makes no quay.
    alone = states_by_scan(model)
    assert states_by_scan(with_answers(model, 1)) == alone


def test_a_radar_that_does_not_see_a_place_leaves_its_neighbourhood():
    near = with_answers(resolve(COAST).model, 5)
    far = {"far.clutter_map": True, "far.position": [6e4, 0.0], "far.max_range": 2e4}
    both = resolve({**COAST, **far, "sensors": ["mast", "far"]}).model
    both = replace(both, radars=(near.radars[0], both.radars[1]))
    assert states_by_scan(both) == states_by_scan(near)
