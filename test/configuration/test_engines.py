import pytest
from scenes import short_scenario, small

from phd_jdtc_ros.configuration.engines import ENGINES, new_engine
from phd_jdtc_ros.configuration.parameters.tracker import ENGINE_OF
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.configuration.tables import TOP
from phd_jdtc_ros.simulation.simulate import simulate


def test_engines_are_what_the_parameter_may_be():
    (parameter,) = [parameter for parameter in TOP if parameter.name == "engine"]
    assert {ENGINE_OF[choice] for choice in parameter.choices} == {*ENGINES}
    with pytest.raises(ConfigError, match="engine: 'steam' given, must be one of gaussian"):
        small({"engine": "steam"})


@pytest.mark.parametrize("name", ENGINES)
def test_every_engine_does_what_the_seam_asks_for(name):
    config = small({"engine": name, "lag": 2})
    scans = [scan for _, scan in simulate(short_scenario(6), 0)]
    engine, other = new_engine(config), new_engine(config)
    for scan in scans[:4]:
        step = engine.step(scan)
    assert step.class_mass.shape == (2,)
    assert all(isinstance(figure, (int, float)) for figure in step.figures.values())
    with pytest.raises(ValueError, match="not later"):
        engine.step(scans[3])

    held = engine.snapshot()
    assert held.stamp_ns == scans[3].stamp_ns
    other.restore(held)
    engine.retune(config.model, config.rule)
    other.retune(config.model, config.rule)
    for scan in scans[4:]:
        (one,), (two,) = engine.step(scan).filtered, other.step(scan).filtered
        assert (one.state == two.state).all()
    assert [found.lag for found in engine.flush()] == [1, 0]
    assert engine.flush() == ()
    assert len(other.interrupt()) == 2


def test_a_lag_in_seconds_may_be_longer_than_the_time_between_estimates():
    config = small({"lag": "12 s", "estimates_period_s": 24.0})
    engine = new_engine(config)
    steps = [engine.step(scan) for _, scan in simulate(short_scenario(12), 0)]
    stamps = [found.stamp_ns // 10**9 for step in steps for found in step.smoothed]
    # The first scan is at 1000 s, the last at 1066 s.
    assert stamps == [1008, 1032]
    assert [found.stamp_ns // 10**9 for found in engine.flush()] == [1056]
