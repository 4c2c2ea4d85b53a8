"""Where the platforms of moving radars are: odometry, poses or transforms, as poses by radar."""

from __future__ import annotations

from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.place_forms import STATIC_TRANSFORMS, TF
from phd_jdtc_ros.core.intake.posed_reports import RadarPose
from phd_jdtc_ros.core.intake.poses import PoseFault
from phd_jdtc_ros.core.intake.transforms import TransformBuffer

from ..encoding import names
from . import platform_poses, tf

# Types of the messages by their configured name.
TYPES = {**platform_poses.TYPES, TF: names.TRANSFORMS}


def types_of(config: TrackerConfig) -> dict[str, str]:
    """Return the type of the messages on each topic with poses or transforms."""
    by_topic = config.radars_by_platform
    return {topic: TYPES[config.inputs[own[0]].pose.message] for topic, own in by_topic.items()}


class MovingRadars:
    """Reads the messages on the topics of `TrackerConfig.radars_by_platform`."""

    def __init__(self, config: TrackerConfig) -> None:
        self._inputs, self._carried = config.inputs, config.radars_by_platform
        self._world_frame = config.world_frame
        # The radars that the transforms place, by frame.
        self._radars_of: dict[str, list[int]] = {}
        for index in self._carried.get(STATIC_TRANSFORMS, ()):
            self._radars_of.setdefault(tf.plain(config.inputs[index].frame), []).append(index)
        self._buffer = TransformBuffer(
            tf.plain(config.world_frame), self._radars_of, config.reset_threshold_s
        )

    def read(self, topic: str, data: bytes) -> tuple[list[RadarPose], list[PoseFault]]:
        """Return the poses that follow from a serialised message, and faults that harm none.

        Raise `RejectedMessageError`, see `platform_poses.from_msg` and `tf.from_cdr`.
        """
        carried = self._carried[topic]
        message = self._inputs[carried[0]].pose.message
        if message != TF:
            stamp_ns, pose = platform_poses.from_cdr(data, message, self._world_frame)
            return [RadarPose(radar, stamp_ns, pose) for radar in carried], []
        static = topic == STATIC_TRANSFORMS
        sent = tf.from_cdr(data, self._buffer.needs)
        faults = [PoseFault.PARENT for each in sent if self._buffer.add(each, static)]
        found = [
            RadarPose(radar, stamp_ns, pose)
            for frame, radars in self._radars_of.items()
            for stamp_ns, pose in self._buffer.poses(frame)
            for radar in radars
        ]
        return found, faults

    def missing(self, radar: int) -> str:
        """Return why a moving radar has no pose."""
        source = self._inputs[radar]
        text = f"no pose on {source.pose.topic} within {source.pose_max_age_s:g} s"
        if source.pose.message != TF:
            return text
        frame = tf.plain(source.frame)
        late = self._buffer.late(frame)
        return self._buffer.broken(frame) or (f"{text}: {late}" if late else text)

    @property
    def broken(self) -> str:
        """Where the first chain of transforms is broken; empty if none is."""
        return next(filter(None, map(self._buffer.broken, self._radars_of)), "")

    def holds(self, topic: str) -> bool:
        """Return whether the last transforms on a topic hold until the next, however late."""
        fixed = topic == STATIC_TRANSFORMS or all(map(self._buffer.is_fixed, self._radars_of))
        return fixed and not self.broken
