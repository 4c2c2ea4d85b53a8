import time
from dataclasses import replace

import numpy as np
import pytest
from bag_content import edited, messages, rewrite
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from records import SHORT, record_of, shrunk
from reference import resolve
from unfolded import columns_of

from msg_adapters.encoding import names
from msg_adapters.incoming import detections
from msg_adapters.outgoing import diagnostics
from msg_adapters.targets import estimates, tracks, truth
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.parameters.position import PositionParameters
from phd_jdtc_ros.core.factors.outliers import Outliers
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.report import load
from phd_jdtc_ros.report.page import words
from phd_jdtc_ros.report.page.layers import Columns, pack
from phd_jdtc_ros.report.record import Sets, learned_values, sensor_changes
from phd_jdtc_ros.report.style import MapScale, metres_text, places_of
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.targets import TargetScript
from phd_jdtc_ros.tools.simulate import write_bag
from phd_jdtc_ros.tools.track_bag import track_bag

CONFIG = resolve({"lag": 2})
RADARS = [radar.topic for radar in CONFIG.inputs]
FILTERED, SMOOTHED = names.estimates("filtered"), names.estimates("smoothed")
SECOND = 10**9
# Differences of these have 31 bits and a sign.
WHOLE = st.lists(st.integers(-(2**30), 2**30 - 1), max_size=40)
INPUTS = resolve(
    {
        "sensors": ["mast"],
        "mast.learn": ["noise", "detection"],
        "mast.range_std": 50.0,
        "mast.azimuth_std_deg": 0.2,
        "mast.detection_probability": 0.9,
    }
).inputs
FIGURES = {
    "mast.detection_probability": 0.6,
    "mast.detection_probability_std": 0.02,
    "mast.detection_probability_set": 0.9,
    "mast.range_noise_ratio": 2.0,
    "mast.range_noise_ratio_std": 0.1,
    "mast.azimuth_noise_ratio": 0.5,
    "mast.azimuth_noise_ratio_std": 0.05,
}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Return a tracked bag of 4 scans."""
    directory = tmp_path_factory.mktemp("load")
    target = TargetScript(0, 3e4, (-10e3, 10e3), (36.0, -44.0), 0, 3)
    scenario = Scenario(1000 * SECOND, 6.0, 4, (target,), CONFIG.model.radars)
    write_bag(directory / "in", scenario, CONFIG, 0)
    track_bag(BagReader(directory / "in"), CONFIG, directory / "out")
    return directory / "out"


def assert_same(one, other):
    assert len(one) == len(other) == 4
    for a, b in zip(one, other, strict=True):
        for name in a.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_record_holds_truth_estimates_and_radar_positions(bag):
    run = load.record(bag, CONFIG)
    assert_same(run.truth, [truth.from_msg(cloud) for cloud in messages(bag, names.TRUTH)])
    assert_same(run.filtered, [estimates.from_msg(cloud) for cloud in messages(bag, FILTERED)])
    assert_same(run.smoothed, [estimates.from_msg(cloud) for cloud in messages(bag, SMOOTHED)])
    assert run.classes == 2
    assert run.step_ms.shape == (0,)
    expected = [(model.name, model.position) for model in CONFIG.model.radars]
    sites = load.record(bag, CONFIG).radars
    assert [(site.name, site.position) for site in sites] == expected


def test_record_places_the_detections_in_the_world(bag):
    run = load.record(bag, CONFIG)
    assert [plot.stamp_ns for plot in run.plots] == [
        (1000 + 6 * scan) * SECOND for scan in range(4) for _ in CONFIG.inputs
    ]
    assert [plot.radar for plot in run.plots] == ["radar_1", "radar_2"] * 4
    for radar, model in zip(CONFIG.inputs, CONFIG.model.radars, strict=True):
        plots = [plot for plot in run.plots if plot.radar == radar.name]
        for plot, cloud in zip(plots, messages(bag, radar.topic), strict=True):
            report = detections.from_msg(cloud, radar).detections
            distance = np.hypot(*(plot.position - model.position).T)
            np.testing.assert_allclose(distance, report.measurement[:, 0], rtol=1e-12)
            np.testing.assert_array_equal(plot.amplitude, report.amplitude)


def test_record_orders_by_stamp_whatever_the_order_of_recording(bag, tmp_path):
    last = 2000 * SECOND
    backwards = rewrite(bag, tmp_path / "bag", change=lambda e: [(e[0], e[1], last - e[2])])
    one, other = load.record(backwards, CONFIG), load.record(bag, CONFIG)
    for name in ("truth", "filtered", "smoothed"):
        assert_same(getattr(one, name), getattr(other, name))
    stamps = [plot.stamp_ns for plot in one.plots]
    assert stamps == sorted(stamps)


def test_record_reads_step_times_from_the_figures(bag, tmp_path):
    figures = [
        diagnostics.array(scan, [diagnostics.status("all", {"step_ms": 1.5 * scan})])
        for scan in range(3)
    ]
    sent = [
        (serialize_message(figure), (1001 + 6 * k) * SECOND) for k, figure in enumerate(figures)
    ]
    more = (names.cardinality(), names.FIGURES, sent)
    run = load.record(rewrite(bag, tmp_path / "bag", add=[more]), CONFIG)
    assert run.step_ms.tolist() == [0.0, 1.5, 3.0]


@pytest.mark.parametrize("statuses", [[], [diagnostics.status("all", {"total": 3.0})]])
def test_record_reads_past_figures_without_step_times(bag, tmp_path, statuses):
    data = serialize_message(diagnostics.array(0, statuses))
    more = (names.cardinality(), names.FIGURES, [(data, 1001 * SECOND)])
    run = load.record(rewrite(bag, tmp_path / "bag", add=[more]), CONFIG)
    assert run.step_ms.tolist() == []
    assert len(run.filtered) == 4


@pytest.mark.parametrize(
    ("missing", "lengths"),
    [
        ([names.TRUTH], (0, 8, 4, 4)),
        (RADARS[:1], (4, 4, 4, 4)),
        ([FILTERED], (4, 8, 0, 4)),
        ([SMOOTHED], (4, 8, 4, 0)),
        ([FILTERED, SMOOTHED], (4, 8, 0, 0)),
    ],
)
def test_record_has_what_the_bag_has(bag, tmp_path, missing, lengths):
    run = load.record(rewrite(bag, tmp_path / "bag", drop=missing), CONFIG)
    assert tuple(map(len, (run.truth, run.plots, run.filtered, run.smoothed))) == lengths
    assert run.classes == 2


def test_record_has_no_estimates_of_another_tracker(bag, tmp_path):
    added = [
        (
            names.estimates(source, "/mine"),
            names.CLOUD,
            [(e.data, e.log_time_ns) for e in BagReader(bag).messages([names.estimates(source)])],
        )
        for source in ("filtered", "smoothed")
    ]
    path = rewrite(bag, tmp_path / "bag", drop=[FILTERED, SMOOTHED], add=added)
    assert load.record(path, CONFIG).smoothed == ()


def test_record_refuses_a_bag_with_nothing_of_a_run(bag, tmp_path):
    path = rewrite(bag, tmp_path / "bag", drop=[FILTERED, SMOOTHED, names.TRUTH, *RADARS])
    with pytest.raises(BagError, match=f"none of {FILTERED}.*{RADARS[1]} is in it") as caught:
        load.record(path, CONFIG)
    assert not caught.value.corrupt


@pytest.mark.parametrize("topic", [FILTERED, names.TRUTH, RADARS[0], names.cardinality()])
def test_record_refuses_an_optional_topic_of_another_type(bag, tmp_path, topic):
    data = tracks.poses_to_cdr(load.record(bag, CONFIG).filtered[0], 0, "map")
    more = (topic, names.POSES, [(data, 1001 * SECOND)])
    path = rewrite(bag, tmp_path / "bag", drop=[topic], add=[more])
    with pytest.raises(BagError, match=f"{topic} is {names.POSES}, must be ") as caught:
        load.record(path, CONFIG)
    assert not caught.value.corrupt


def test_record_refuses_estimates_that_are_none(bag, tmp_path):
    def spoil(entry):
        return [(entry[0], b"\0\1\0\0", entry[2])] if entry[0] == SMOOTHED else [entry]

    path = rewrite(bag, tmp_path / "bag", change=spoil)
    with pytest.raises(BagError, match=str(path)) as caught:
        load.record(path, CONFIG)
    assert "\n" not in str(caught.value)


def test_record_leaves_out_detections_that_the_tracker_rejects_too(bag, tmp_path):
    def spoil(cloud):
        cloud.header.frame_id = "elsewhere"

    first = edited(spoil, lambda topic, log_time: (topic, log_time) == (RADARS[0], 1000 * SECOND))
    run = load.record(rewrite(bag, tmp_path / "bag", first), CONFIG)
    assert len(run.plots) == 7
    assert len(run.filtered) == 4


def test_record_of_detections_without_amplitude_has_none(bag, tmp_path):
    def rename(cloud):
        cloud.fields[-1].name = "something"

    of_one_radar = edited(rename, lambda topic, _: topic == RADARS[0])
    run = load.record(rewrite(bag, tmp_path / "bag", of_one_radar), CONFIG)
    for plot in run.plots:
        assert plot.amplitude.shape == plot.position.shape[:1]
        assert np.isnan(plot.amplitude).all() == (plot.radar == "radar_1")


@given(WHOLE, WHOLE)
def test_columns_are_read_back_as_they_were(first, second):
    columns = Columns()
    columns.add("first", first)
    columns.add("second", second)
    found = columns_of(columns.text(), columns.index)
    assert found["first"].tolist() == first
    assert found["second"].tolist() == second


def test_columns_of_steady_motion_take_less_than_a_byte_an_entry():
    columns = Columns()
    columns.add("x", 250 * np.arange(10_000))
    assert len(columns.text()) < 1_000


def test_packed_is_the_same_at_any_time(monkeypatch):
    now = pack(b"a page" * 100)
    monkeypatch.setattr(time, "time", lambda: 2e9)
    assert pack(b"a page" * 100) == now


def test_sets_are_all_and_each_of_several_classes():
    sets = Sets.of(2, ("car", "van_2"))
    assert sets.keys == ["all", "class_0", "class_1"]
    assert [sets.title(key) for key in sets.keys] == ["all classes", "car", "van_2"]
    sets = Sets.of(1, ("car",))
    assert sets.one_class
    assert (sets.keys, sets.title("all")) == (["all"], "car")
    assert Sets.of(2, ("car", "van")).class_title(7) == "class 7"


@pytest.mark.parametrize("names", [(), ("car",), ("class_0", "class_1")])
def test_sets_without_fitting_names_are_numbered(names):
    assert [Sets.of(2, names).class_title(k) for k in range(2)] == ["class 0", "class 1"]


def test_sets_of_a_summary_are_those_of_its_figures():
    figures = {"all": {}, "class_0": {}, "class_1": {}}
    summary = {"filtered": figures, "smoothed": figures}
    assert Sets.of_summary(summary) == Sets.of(2)
    assert Sets.of_summary({**summary, "class_names": ["car", "van"]}) == Sets(("car", "van"))


@pytest.mark.parametrize(
    ("record", "unit"),
    [
        (record_of(2), "km"),
        (shrunk(record_of(2)), "m"),
        (record_of(2, truth=(), filtered=(), smoothed=()), "km"),
        (shrunk(record_of(2, truth=(), filtered=(), smoothed=())), "m"),
        (record_of(2, truth=(), filtered=(), smoothed=(), plots=()), "km"),
    ],
)
def test_scale_is_metres_where_the_places_are_close(record, unit):
    assert MapScale.of(record).unit == unit


def test_scale_of_targets_ignores_detections_far_away():
    targets, far = shrunk(record_of(2)), record_of(2).plots
    assert MapScale.of(record_of(2, truth=targets.truth, filtered=(), smoothed=(), plots=far)) == (
        MapScale.of(targets)
    )


def test_places_of_a_record_are_in_metres():
    assert np.ptp(places_of(shrunk(record_of(2)))[:, 1]) == pytest.approx(2040.0 * SHORT)


@pytest.mark.parametrize(
    ("metres", "text"),
    [
        (103.4, "103 m"),
        (63.8, "64 m"),
        (9.96, "10 m"),
        (4.62, "4.6 m"),
        (0.462, "0.46 m"),
        (0.0, "0 m"),
    ],
)
def test_metres_text_has_two_digits_or_more(metres, text):
    assert metres_text(metres) == text


def test_values_are_those_learned_in_the_units_of_parameters():
    found = {each.quantity: each for each in learned_values(INPUTS, FIGURES)}
    assert found["detection_probability"][2:] == (0.9, 0.6, 0.02, "")
    assert found["range_std"][2:] == (50.0, 100.0, 5.0, "m")
    assert found["azimuth_std_deg"][2:5] == pytest.approx((0.2, 0.1, 0.01))
    shares = learned_values(INPUTS, {"mast.outlier_share": 0.2, "mast.outlier_share_std": 0.02})
    assert [tuple(each) for each in shares] == [
        ("mast", "share of outliers", Outliers.start, 0.2, 0.02, "")
    ]
    assert not list(learned_values(INPUTS, {"other.range_noise_ratio": 2.0}))


def test_learned_values_of_one_parameter_are_told_apart_by_their_components():
    lidar = PositionParameters(name="lidar")
    figures = {f"lidar.{a}_noise_ratio{b}": 0.5 for a in "xy" for b in ("", "_std")}
    found = [each.quantity for each in learned_values([lidar], figures)]
    assert found == ["position_std of x", "position_std of y"]


def test_page_shows_what_was_set_and_found_of_which_sensor():
    record = replace(record_of(), learned=tuple(learned_values(INPUTS, FIGURES)))
    text = words.sensors(record.learned, {})
    cells = "".join(f"<td>{cell}</td>" for cell in ("50 m", "100 m", "5 m"))
    assert f'<th scope="row">mast: range_std</th>{cells}' in text
    changes = sensor_changes(INPUTS, {**FIGURES, "mast.fewer_detections": 1.0})
    text = words.sensors(tuple(learned_values(INPUTS, FIGURES)), changes)
    assert "<strong>mast</strong>: has changed: it detects fewer targets." in text
    assert sensor_changes(INPUTS, FIGURES) == {}
    assert words.sensors((), {}) == ""


def test_record_of_a_tracker_in_space_has_plots_of_the_plane(tmp_path):
    bag = BagReader(resources.bag("drones"))
    config = from_arguments.config_of(bag_parameters.read(resources.bag("drones")))
    track_bag(bag, config, tmp_path / "out")
    run = load.record(tmp_path / "out", config)
    plots = run.all_plots.position
    assert len(plots) > 1000
    # The radar's slant ranges are longer than these.
    assert np.hypot(*plots.T).max() < config.radars[0].max_range
