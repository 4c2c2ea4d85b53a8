"""The study of the places that a lidar reports, on a part of its scene."""

from studies import positions


def test_velocities_and_heights_of_a_lidar_are_used(monkeypatch):
    monkeypatch.setattr(positions, "SCANS", 120)
    figures = positions.measure(None, 5)
    places, moving, space = (figures[name]["filtered"] for name in positions.TRACKERS)
    assert places["found"] > 97.0
    assert moving["rms"] < 0.75 * places["rms"] < 0.15
    assert abs(space["rms"] - moving["rms"]) < 0.01
    assert space["height rms"] < 0.12
    assert space["false"] < 0.1
    assert all(each["switches"] == 0 for each in (places, moving, space))
    assert len(positions.goals(figures)) == 5
    assert positions.tables(figures)[0].row_count == 3
