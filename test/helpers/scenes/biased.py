"""Radars with systematic errors: the study's scenario, smaller."""

from pathlib import Path

from phd_jdtc_ros.calibration.registration.common import tracked_radar
from phd_jdtc_ros.calibration.tuning.plots import plots_of
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports

ROOT = Path(__file__).parents[3]
MINUTES, AIRCRAFT = 4, 15


def document(**changes):
    """Return the scenario of three radars around an area, with some minutes and aircraft."""
    found = yaml_files.load(ROOT / "config" / "scenarios" / "three_biased_radars.yaml")
    found["scans"] = 60 * MINUTES + 1
    found["traffic"]["aircraft"] = AIRCRAFT
    return {**found, **changes}


def scene(given, **parameters):
    """Return the configuration and the scenario of a document."""
    config = resolve({**from_arguments.scenario_parameters(given), **parameters})
    return config, scenario_file.resolve(given, config.model.radars)


def sensors(given, seed, **parameters):
    """Return the radars of a run with their tracks."""
    config, scenario = scene(given, **parameters)
    reports = simulate_reports(scenario, config.inputs, seed)
    found = []
    for index, radar in enumerate(config.model.radars):
        own = [(each.stamp_ns, each.detections) for each in reports if each.radar == index]
        found.append(tracked_radar(plots_of(own), radar, scenario.start_ns, False))
    return found
