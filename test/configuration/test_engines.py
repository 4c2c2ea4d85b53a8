import pytest
from scenes import short_scenario, small

from phd_jdtc_ros.configuration import build, tables
from phd_jdtc_ros.configuration.engines import ENGINES, new_engine
from phd_jdtc_ros.configuration.parameters.tracker import LABELLED
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.configuration.tables import TOP
from phd_jdtc_ros.nodes.tracker import settings
from phd_jdtc_ros.simulation.simulate import simulate

GIVEN = {"sensors": ["ais", "radar_1"], "ais.kind": "position", "ais.position_std": 9.0}


def test_engines_are_what_the_parameter_may_be():
    (parameter,) = [parameter for parameter in TOP if parameter.name == "engine"]
    assert {*parameter.choices} == {*ENGINES}
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

    if name in LABELLED:
        held = engine.snapshot()
        assert held.stamp_ns == scans[3].stamp_ns
        other.restore(held)
    else:
        with pytest.raises(ValueError, match="keeps no state"):
            engine.snapshot()
        for scan in scans[:4]:
            other.step(scan)
    engine.retune(config.model, config.rule)
    other.retune(config.model, config.rule)
    for scan in scans[4:]:
        (one,), (two,) = engine.step(scan).filtered, other.step(scan).filtered
        assert (one.state == two.state).all()
    assert [found.lag for found in engine.flush()] == [1, 0]
    assert engine.flush() == ()
    assert len(other.interrupt()) == 2


def test_a_lag_in_seconds_may_be_longer_than_the_time_between_estimates():
    config = small({"lag_s": 12.0, "estimates_period_s": 24.0})
    engine = new_engine(config)
    steps = [engine.step(scan) for _, scan in simulate(short_scenario(12), 0)]
    stamps = [found.stamp_ns // 10**9 for step in steps for found in step.smoothed]
    # The first scan is at 1000 s, the last at 1066 s.
    assert stamps == [1008, 1032]
    assert [found.stamp_ns // 10**9 for found in engine.flush()] == [1056]


def test_a_kind_is_refused_with_those_that_there_are():
    with pytest.raises(ConfigError) as refused:
        build.resolve({"radar_1.kind": "sonar", "radar_1.range_std": 9.0})
    assert refused.value.faults == (
        "radar_1.kind: 'sonar' given, must be one of radar, position, reports",
    )


@pytest.mark.parametrize("kind", [3, ["radar"], ""])
def test_what_is_no_name_of_a_kind_is_refused(kind):
    with pytest.raises(ConfigError, match=r"radar_1\.kind: .* given, must be one of radar"):
        build.resolve({"radar_1.kind": kind})


def test_each_sensor_has_the_parameters_and_the_model_of_its_kind():
    table = tables.schema(GIVEN)
    assert {"ais.position_std", "ais.topic", "radar_1.range_std"} <= table.keys()
    assert not {"ais.range_std", "radar_1.position_std"} & table.keys()
    config = build.resolve(GIVEN)
    assert [sensor.may_turn for sensor in config.inputs] == [False, True]
    assert (config.inputs[0].topic, config.model.radars[0].std) == ("/ais/detections", (9.0, 9.0))
    assert config.revolutions()[0].period_s == 0.0


def test_checks_and_names_are_those_of_the_kind():
    with pytest.raises(ConfigError) as refused:
        build.resolve({**GIVEN, "ais.fields.vx": "", "ais.fields.x": "", "engine": "phd"})
    assert {
        "ais.kind: position given, must be radar with engine phd",
        "ais.fields.x: '' given, must be a name",
        "ais.fields.vx: '' given, must be a name with fields.vy",
    } <= {*refused.value.faults}
    with pytest.raises(ConfigError) as refused:
        build.resolve({**GIVEN, "ais.range_std": 1.0, "ais.fields.range": "r"})
    assert refused.value.faults == (
        "ais.range_std: unknown parameter, range_std is a parameter of sensors of kind radar",
        "ais.fields.range: unknown parameter, fields.range is a parameter of sensors of kind radar",
    )


@pytest.mark.parametrize("area", [[], [0, 0, 0, 9], [0, 0, 9], [0, 0, 5, 5, 9, 9], [0, 0, 1e9, 1]])
def test_an_area_has_a_size(area):
    with pytest.raises(ConfigError, match=r"ais\.area: .* given, must be \[x_min, y_min, x_max"):
        build.resolve({**GIVEN, "ais.area": area})


def test_what_supports_radars_only_refuses_other_kinds():
    with pytest.raises(ConfigError, match=r"^ais\.kind: position given, must be radar here$"):
        _ = build.resolve(GIVEN).radars


def test_input_checks_of_azimuths_are_only_for_radars():
    checks = build.resolve(GIVEN).report_checks()
    assert [type(each).__name__ for each in checks] == ["PositionReportCheck", "RadarReportCheck"]


def test_another_kind_changes_the_parameters_of_a_live_tracker():
    values = settings.resolve({"sensors": ["radar_1"], "radar_1.topic": "/here"}).values
    table, edited = settings.edit(values, {"radar_1.kind": "position"})
    assert "radar_1.range_std" not in table
    names = ("topic", "position_std")
    assert [edited[f"radar_1.{name}"] for name in names] == ["/here", 0.5]


def test_the_registration_of_other_kinds_is_refused():
    with pytest.raises(ConfigError, match=r"^outputs: registration given, ais is not a radar$"):
        settings.resolve({**GIVEN, "outputs": ["registration"]})
