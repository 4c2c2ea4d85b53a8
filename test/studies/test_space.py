"""The study of targets in space on one scene."""

from studies import space


def test_space_finds_heights_where_the_plane_has_none(monkeypatch):
    name = "two slant ranges"
    monkeypatch.setattr(space, "SCENES", {name: space.SCENES[name]})
    figures = space.measure(None, 5)
    found = figures[name]
    assert found["space"]["smoothed"]["height rms"] < 500.0
    assert found["space"]["smoothed"]["missed"] < 3.0
    assert found["space"]["filtered"]["ospa"] < 0.6 * found["by hand"]["filtered"]["ospa"]
    assert found["plane"]["filtered"]["height rms"] is None
    (shown,) = space.tables(figures)
    assert shown.row_count == 3
