from dataclasses import replace

import numpy as np
import pytest
from lone import MEAN, lone
from runs import alike, equal, stepped
from scenes import no_detections, plain, short_scenario, small
from scipy import sparse
from scipy.stats import multivariate_normal

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.attributes.uniqueness import OutOfGate
from phd_jdtc_ros.core.engine import Lag
from phd_jdtc_ros.core.models.manoeuvre import PROBABILITY, manoeuvre
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.smc.particle_set import ParticleSet
from phd_jdtc_ros.core.smc.proposals.detections_in_plane import report_in_plane
from phd_jdtc_ros.core.smc.reacquisition import with_reacquired
from phd_jdtc_ros.core.smc.resampling import YOUNG_FACTOR
from phd_jdtc_ros.core.types import Detections, Scan
from phd_jdtc_ros.simulation.simulate import simulate
from phd_jdtc_ros.simulation.traffic.targets import TargetScript

SCANS = [scan for _, scan in simulate(short_scenario(8), 3)]
THREE_CLASSES = {
    "classes": ["strong", "weak", "turning"],
    "strong.snr_band_db": [30.0, 50.0],
    "weak.snr_band_db": [10.0, 30.0],
    "weak.motions": ["cv"],
    "weak.mode_transition": [1.0],
    "turning.snr_band_db": [10.0, 30.0],
    "turning.motions": ["ct"],
    "turning.mode_transition": [1.0],
    **{f"start_{n}.rates": [0.005, 0.003, 0.002] for n in range(1, 5)},
}
SINCE_S, TIME_S, EXISTENCE = 4.0, -0.5, 0.8
SPEED = np.hypot(*MEAN[[1, 3]])


def run(engine, scans=SCANS):
    """Return the filtered, the smoothed and the flushed estimates of a run."""
    return *stepped(engine, scans), list(engine.flush())


@pytest.mark.parametrize("extraction", ["components", "clusters"])
def test_engine_gives_the_same_run_for_the_same_seed(extraction):
    config = small({"lag": 2, "seed": 7, "recursion.extraction": extraction})
    assert equal(run(new_engine(config)), run(new_engine(config)))


@pytest.mark.parametrize("forget", [["reset"], ["flush"], ["interrupt", "flush"]])
def test_engine_starts_again_after_a_reset(forget):
    engine = new_engine(small({"lag": 2}))
    first = run(engine)  # ends with a flush
    stepped(engine, SCANS[:5])
    for method in forget:
        getattr(engine, method)()
    assert alike(run(engine), first)


def test_engine_keeps_to_its_particles_when_targets_leave_all_coverage():
    # No detection shows that they no longer exist, or which targets they spawned.
    scene = short_scenario(120)
    targets = tuple(
        replace(target, turns=(), first_scan=0, last_scan=119) for target in scene.targets
    )
    scans = [scan for _, scan in simulate(replace(scene, targets=targets), 3)]
    given, most = {"budget.least": 200}, 1500
    usual = list(map(new_engine(small(given)).step, scans))
    assert usual[-1].figures["particles"] > 2 * most
    steps = list(map(new_engine(small({**given, "budget.most": most})).step, scans))
    assert max(step.figures["particles"] for step in steps) <= 1.1 * most
    # Targets have more mass than unconfirmed births and are tracked as without a limit.
    assert [len(step.filtered[0]) for step in steps] == [len(step.filtered[0]) for step in usual]


def tracks(found):
    return {number for one in found for number in one.track_id.tolist()} - {0}


def test_engine_interrupted_gives_out_the_rest_and_new_numbers():
    usual, engine = new_engine(small({"lag": 2})), new_engine(small({"lag": 2}))
    filtered, _, rest = run(usual)
    for scan in SCANS:
        engine.step(scan)
    assert equal(engine.interrupt(), rest)
    again, smoothed, flushed = run(engine)
    highest = max(tracks([*filtered, *rest]))
    assert min(tracks([*again, *smoothed, *flushed])) == highest + 1
    # The engine is like a new one except for the track numbers.
    for first, second in zip(filtered, again, strict=True):
        np.testing.assert_array_equal(first.state, second.state)
        shifted = np.where(first.track_id > 0, first.track_id + highest, 0)
        np.testing.assert_array_equal(shifted, second.track_id)


@pytest.mark.parametrize("lag", [0, 1])
def test_engine_filters_alike_whatever_the_lag(lag):
    filtered = run(new_engine(small({"lag": lag})))[0]
    reference = run(new_engine(small({"lag": 5})))[0]
    assert equal(filtered, reference)


@pytest.mark.parametrize(
    ("stamps", "reached"), [([0], False), ([0, 1, 2], False), ([0, 1, 2, 3], True)]
)
def test_lag_in_scans_counts_those_that_follow(stamps, reached):
    assert Lag(3).reached(stamps) is reached


def test_engine_goes_on_after_a_refused_stamp():
    refused, unchanged = new_engine(small({"lag": 2})), new_engine(small({"lag": 2}))
    for engine in (refused, unchanged):
        engine.step(SCANS[0])
    with pytest.raises(ValueError, match="not later"):
        refused.step(SCANS[0])
    assert equal(refused.step(SCANS[1]).filtered[0], unchanged.step(SCANS[1]).filtered[0])


def test_engine_does_not_update_with_a_radar_that_did_not_report():
    # A missing report is no evidence of absence, and a report without detections is.
    silent, empty = new_engine(small()), new_engine(small())
    for engine in (silent, empty):
        for scan in SCANS[:4]:
            engine.step(scan)
    stamp_ns = SCANS[4].stamp_ns
    nothing = no_detections()
    unheard = silent.step(Scan(stamp_ns, (None, None))).class_mass.sum()
    unseen = empty.step(Scan(stamp_ns, (nothing, nothing))).class_mass.sum()
    assert 2.7 < unheard < 3.5
    assert unseen < 0.3 * unheard


def test_engine_figures_include_the_particles_per_target():
    def figures(noise):
        """Return those of scans of radars whose noise is `noise` times the usual one."""
        names = ("range_std", "azimuth_std_deg")
        usual = small().values
        given = {
            f"{radar}.{name}": noise * usual[f"{radar}.{name}"]
            for radar in usual["sensors"]
            for name in names
        }
        config = small(given)
        scene = replace(short_scenario(8), radars=config.model.radars)
        engine = new_engine(config)
        return [engine.step(scan).figures for _, scan in simulate(scene, 3)]

    usual, sharp = figures(1.0), figures(0.3)
    assert usual[0]["orphans"] == 0
    assert usual[0]["particles"] <= 200 * 4 * YOUNG_FACTOR + 8 * 20
    for found in (*usual, *sharp):
        assert 0 < found["effective_sample_size"] <= found["particles"]
        assert 0.0 < found["effective_share"] <= 1.0
    # Sharper detections leave fewer of them, above all while targets are young.
    shares = [np.mean([found["effective_share"] for found in each[:3]]) for each in (usual, sharp)]
    assert shares[1] < 0.6 * shares[0]


def one_target_scans(config, scans=6):
    target = TargetScript(0, 1e4, (8e3, 6e3), (-30.0, 20.0), 0, scans - 1)
    scenario = replace(short_scenario(scans), targets=(target,), radars=config.model.radars)
    return simulate(scenario, 1)


@pytest.mark.parametrize("death_term", ["bernoulli", "paper"])
@pytest.mark.parametrize("extraction", ["components", "clusters"])
def test_engine_runs_a_filter_of_one_mode(death_term, extraction):
    config = plain(
        {
            "recursion.death_term": death_term,
            "recursion.extraction": extraction,
            "radar.clutter_rate": 3.0,
            "lag": 2,
            "particles_per_birth": 512,
        }
    )
    engine = new_engine(config)
    for index, (truth, scan) in enumerate(one_target_scans(config)):
        step = engine.step(scan)
        if index < 2:
            continue
        for found in (step.filtered[0], step.smoothed[0]):
            assert len(found) == 1
        error = step.filtered[0].state[0, [0, 2]] - truth.state[0, [0, 2]]
        assert np.hypot(*error) < 700.0  # twice the radar's own error


def test_engine_runs_three_classes_and_no_births():
    config = small(THREE_CLASSES)
    filtered, smoothed, flushed = run(new_engine(config))
    assert filtered[-1].class_probability.shape[1] == 3
    assert len(filtered[-1]) == 3
    assert len(smoothed) + len(flushed) == len(SCANS)
    engine = new_engine(small({"births": [], "lag": 1}))
    filtered, smoothed, flushed = run(engine)
    assert all(len(e) == 0 for e in [*filtered, *smoothed, *flushed])


def strayed(seed=3):
    """Return a set with a target's strays, the target's state, the place and the model."""
    config = lone({"engine": "particles", "particles_per_birth": 4096})
    (radar,) = config.model.radars
    count = 10
    before = ParticleSet(
        state=np.tile(MEAN, (count, 1)),
        mode=np.zeros(count, dtype=np.int64),
        row_label=np.full(count, 5),
        parent=np.arange(count),
        multiplicity=np.ones(count, dtype=np.int64),
        poisson=np.full(count, EXISTENCE / count),
        components=sparse.csr_array((count, 0)),
        label=np.zeros(0, dtype=np.int64),
        log_snr=np.zeros(count),
    )
    place = radar.measure(MEAN[None] + [75.0, 0.0, -60.0, 0.0, 0.0])
    report = Report(radar, Detections(place, None, time_s=np.array([TIME_S])))
    lost = OutOfGate(np.array([0]), np.array([0]), np.array([SINCE_S]))
    rng = np.random.default_rng(seed)
    after = with_reacquired(before, lost, report, config.model, rng)
    return before, after, report_in_plane(report), config.model


def test_strays_have_the_evidence_of_the_manoeuvre_that_leads_to_the_detection():
    before, after, seen, model = strayed()
    new = np.arange(len(before), len(after))
    assert set(after.row_label[new]) == {5}
    at = after.state[new][:, [0, 2]] + TIME_S * after.state[new][:, [1, 3]]
    likelihood = multivariate_normal(seen.position[0], seen.covariance[0]).pdf(at)
    found = float(after.weight[new] @ likelihood)
    expected = MEAN[[0, 2]] + TIME_S * MEAN[[1, 3]]
    done = manoeuvre(np.array([SINCE_S]), SPEED, model)
    spread = seen.covariance[0] + done.position[0] * np.eye(2)
    evidence = multivariate_normal(expected, spread).pdf(seen.position[0])
    # The deviation of the mean of 4096 draws is some per cent.
    assert found == pytest.approx(PROBABILITY * EXISTENCE * evidence, rel=0.1)


def test_strays_have_the_velocities_of_the_manoeuvre():
    before, after, _, model = strayed()
    new = np.arange(len(before), len(after))
    done = manoeuvre(np.array([SINCE_S]), SPEED, model)
    at = after.state[new][:, [0, 2]] + TIME_S * after.state[new][:, [1, 3]]
    moved = at - (MEAN[[0, 2]] + TIME_S * MEAN[[1, 3]])
    change = after.state[new][:, [1, 3]] - MEAN[[1, 3]]
    rest = change - (done.position_velocity / done.position) * moved
    variance = done.velocity - done.position_velocity**2 / done.position
    assert abs(rest.mean()) < 5.0 * np.sqrt(variance[0] / rest.size)
    assert rest.var() == pytest.approx(variance[0], rel=0.1)


def test_target_keeps_the_rest_of_its_weight():
    before, after, _, _ = strayed()
    kept = after.weight[: len(before)].sum()
    assert kept == pytest.approx((1.0 - PROBABILITY) * EXISTENCE)
