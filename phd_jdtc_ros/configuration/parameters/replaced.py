"""Former parameters, each with its replacement in words.

A former name is refused with these words; ``docs/upgrade.md`` is written from these tables.
"""

from __future__ import annotations

from collections.abc import Mapping

CONSTANT = "it is a constant now, {}"
DERIVED = "it follows from the others"
REMAPPED = "remap the topic, as with -r BEFORE:=NOW"
ACCURACY = "use accuracy: fast, normal or high"
ENGINE = "use engine: particles, phd or phd_as_printed"
OUTPUTS = "use outputs, a list with {} in it"
REGION = "use region, the margin as its fifth number"
BIASES = "use biases: [range (m), range gain (m/m), azimuth (degrees), time (s)]"
STEP = "use {}, with the squared step divided by 12 added to its square"
SOURCE = "use output_source: [SAC, SIC, service]"
RECORDED = "use record_topics, with odometry or pose_stamped after the topic"

TRACKER: Mapping[str, str] = {
    "radars": "use sensors",
    "existence_threshold": "use confirm_probability and delete_probability",
    "fixed_interval": "a matrix without a rate matrix applies to whole intervals",
    "reorder_scans": "use reorder_s, or late_reports: rework",
    "region_margin": REGION,
    "detection_births.particles": "use particles_per_birth",
    "lag_s": "use lag, as in '20 s'",
    **dict.fromkeys(("corrector", "death_term", "extraction"), ENGINE),
    **dict.fromkeys(
        ("hypotheses_per_target", "least_hypothesis", "merge_distance", "least_mode"), ACCURACY
    ),
    "max_hypotheses": CONSTANT.format("50000"),
    "least_particles": DERIVED,
    "max_particles": CONSTANT.format("200000"),
    "amplitude_jitter": CONSTANT.format("0.1 per interval"),
    "reply_probability": CONSTANT.format("0.95"),
    "code_garbled": CONSTANT.format("0.01"),
    "shared_code_probability": CONSTANT.format("0.2"),
    "code_kept_s": CONSTANT.format("1800 s"),
    "clutter_reply_probability": CONSTANT.format("0.05"),
    "height_noise_density": CONSTANT.format("1 m^2/s^3"),
    "height_climb_std": CONSTANT.format("10 m/s"),
    "height_garbled": CONSTANT.format("0.01"),
    "height_evidence": CONSTANT.format("1"),
    "spawn.position_std": CONSTANT.format("10 m"),
    "spawn.velocity_std": CONSTANT.format("1 m/s"),
    "spawn.turn_rate_std": CONSTANT.format("0.0001 rad/s"),
    "spawn.particles_per_target": CONSTANT.format("100"),
    "spawn.class_transition": DERIVED,
    "spawn.mode_transition": DERIVED,
}
# Parameters of each name in `sensors`.
RADAR: Mapping[str, str] = {
    "pose_message": "use pose, with pose_stamped after the topic",
    "pose_yaw": "use pose, with stabilised after the topic",
    "pose_max_speed": CONSTANT.format("100 m/s"),
    "range_step": STEP.format("range_std"),
    "azimuth_step_deg": STEP.format("azimuth_std_deg"),
    "detection_probability_over_range": "use detection_probability, which may be such a list",
    "clutter_level_db": "use clutter_amplitude, with the level after the law",
    "clutter_std_db": CONSTANT.format("6 dB"),
    "range_rate_span": CONSTANT.format("200 m/s"),
    "height": "use position, the height as its third number",
    **dict.fromkeys(("range_bias", "range_gain", "azimuth_bias_deg", "time_offset_s"), BIASES),
}
NODE: Mapping[str, str] = {
    **{
        f"publish_{name}": OUTPUTS.format("paths" if name == "path" else name)
        for name in (
            *("detections", "frames", "markers", "plots", "path", "odometry", "radar_tracks"),
            *("detections_3d", "navsat", "geojson"),
        )
    },
    "registration_monitor": OUTPUTS.format("registration"),
    "checkpoint.max_age_s": CONSTANT.format("60 s"),
    "path_length": CONSTANT.format("100"),
    "silent_after_scans": CONSTANT.format("2"),
    "step_time_limit": CONSTANT.format("1"),
}
EVALUATOR: Mapping[str, str] = {
    "truth_topic": REMAPPED,
    "class_names": "use classes, a list of their names",
    "publish_plots": "they are always published",
    "radar_topics": "use record_topics",
    "pose_topics": RECORDED,
    "pose_message": RECORDED,
    "world_frame": "it is the frame of the first cloud",
}
REPLAY: Mapping[str, str] = {
    "progress": "a terminal always has a progress line",
    "estimates_topic": REMAPPED,
    "truth_timeout_s": "use subscriber_timeout_s, a fifth of which is the wait for the truth",
}
BRIDGE: Mapping[str, str] = {
    "estimates_topic": REMAPPED,
    "max_prediction_s": CONSTANT.format("10 s"),
    **dict.fromkeys(("output_sac", "output_sic", "output_service"), SOURCE),
}
BRIDGE_RADAR: Mapping[str, str] = dict.fromkeys(("sac", "sic"), "use source: [SAC, SIC]")
HAND_OVER: Mapping[str, str] = {
    "smoothed_wait_s": CONSTANT.format("8 s"),
    "world_frame": "it is the frame of the first estimates",
}
HAND_OVER_TRACKER: Mapping[str, str] = {"region_margin": REGION}
