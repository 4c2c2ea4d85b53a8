"""The benchmarks and their gate: baselines and summaries are correct; no time is tested."""

import json

import numpy as np
import pytest
from rich.console import Console

from benchmarks import command, gate, scenes
from benchmarks.engine import recursion, step_growth
from benchmarks.transport import asterix_rates, sector_latency, turning
from phd_jdtc_ros.simulation.simulate import simulate

WITHOUT_ROS = ("peers", "steps", "step_growth")


def test_engine_tracks_all_targets_of_a_crowd_from_its_first_scan():
    config = scenes.configuration(20)
    scene = scenes.crowd(20, 4, config, seed=1)
    run = recursion.tracking(config, scene)
    for truth, scan in simulate(scene, 1):
        step = run.step(scan)
        assert step.class_mass.sum() == pytest.approx(20.0, abs=2.0)
        (found,) = step.filtered
        apart = np.linalg.norm(found.position[:, None] - truth.position[None], axis=2)
        assert np.median(apart.min(axis=0)) < 300.0


def test_a_revolution_is_of_a_tracker_that_has_all_aircraft_in_every_form(cost):
    assert set(cost) == set(turning.FORMS)
    for found in cost.values():
        assert found["rounds"] == 1
        assert found["targets"] == pytest.approx(50.0, abs=2.0)


@pytest.fixture(scope="module")
def cost():
    """The cost of one revolution, as soon as all aircraft are tracked."""
    return turning.cost(1, settling=4)


@pytest.mark.live
def test_latency_by_sectors_is_measured_on_a_live_tracker_that_has_all_aircraft(monkeypatch):
    # The variables that the measurement sets are reset afterwards.
    for name in ("ROS_AUTOMATIC_DISCOVERY_RANGE", "FASTDDS_BUILTIN_TRANSPORTS"):
        monkeypatch.setenv(name, "")
    found = sector_latency.measure(1)
    assert found.get("reason") is None
    assert found["sectors"] == 16
    assert found["detections"] >= 40
    assert found["targets"] == pytest.approx(50.0, abs=2.0)
    # The antenna passes a sector in 0.25 s, and its detections wait for its end.
    assert 0.1 < found["latency_s"]["p50"] < found["latency_s"]["most"]
    assert found["step_ms"]["p99"] > 0.0


@pytest.fixture(scope="module")
def summary():
    """The quick run of all that needs no ROS, with few targets."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(step_growth, "QUICK_LADDER", (4, 8))
        patch.setattr(step_growth, "QUICK_MEMORY_TARGETS", 4)
        patch.setattr(step_growth, "STEPS", 2)
        return command.run(True, WITHOUT_ROS, Console(quiet=True))


def test_summary_holds_every_figure(summary):
    names = [figure["name"] for figure in summary["figures"]]
    assert len(names) == len(set(names)) == 23
    for figure in summary["figures"]:
        keys = {"name", "value", "goal", "at_most", "reached"}
        if figure["value"] is None:
            assert set(figure) == {*keys, "reason"}
            assert figure["reached"] is None
            assert figure["reason"]
        else:
            assert set(figure) == keys
            within = figure["value"] <= figure["goal"]
            assert figure["reached"] == (within if figure["at_most"] else not within)


def test_write_leaves_the_summary_and_the_pictures(summary, tmp_path):
    paths = command.write(summary, tmp_path / "bench")
    assert json.loads(paths[0].read_text()) == json.loads(json.dumps(summary))
    assert {path.name for path in paths} == {
        "summary.json",
        "table.md",
        "step_against_targets.png",
    }
    assert all(path.stat().st_size > 10_000 for path in paths[2:])


def test_every_way_to_read_asterix_reads_the_same_plots():
    datagrams = asterix_rates.revolution()
    assert asterix_rates._to_plots(datagrams) == asterix_rates.PLOTS
    assert asterix_rates._to_clouds(datagrams) == asterix_rates.PLOTS
    part = [data for data in datagrams if data[0] == 48][:2]
    assert asterix_rates._by_library(part) == asterix_rates._to_plots(part) > 0


@pytest.mark.parametrize(("now", "status"), [(1.3, 1), (1.1, 0)])
def test_main_fails_if_an_engine_is_slower_than_allowed(monkeypatch, capsys, now, status):
    monkeypatch.setattr(gate, "seconds", lambda source: now if source == gate.ROOT else 1.0)
    assert gate.main(["HEAD"]) == status
    assert f"{now:.2f} times" in capsys.readouterr().out


def test_benchmark_fails_if_a_figure_that_was_measured_is_missing(tmp_path, monkeypatch, capsys):
    def ended(found):
        monkeypatch.setattr(command, "PARTS", {"asterix": lambda quick: found})
        return command.main(["--out", str(tmp_path), "--part", "asterix"])

    whole = {"plots_per_s": {asterix_rates.CLOUDS: 1e5}, "tracks_ms": 1.0}
    assert (
        ended({**whole, "live": {"value": None, "reason": "no tracks of the first revolutions"}})
        == 1
    )
    missing = [line for line in capsys.readouterr().out.splitlines() if "missing: " in line]
    assert len(missing) == 1
    assert "ASTERIX in to ASTERIX out" in missing[0]
    latency = {"aircraft": 1, "sectors": 1, "latency_s": {"p50": 0.1, "p99": 0.2, "most": 0.2}}
    assert ended({**whole, "live": latency}) == 0
