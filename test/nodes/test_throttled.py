from phd_jdtc_ros.nodes.common.health import ThrottledWarnings


class Logger:
    def __init__(self):
        self.said = []

    def warning(self, text):
        self.said.append(text)


def test_every_subject_is_throttled_by_itself():
    logger, now = Logger(), [0.0]
    warnings = ThrottledWarnings(logger, lambda: now[0])
    for second in range(8):
        now[0] = float(second)
        for radar in ("north", "south"):
            warnings.warn((radar, "late"), f"{radar} at {second}")
    assert logger.said == ["north at 0", "south at 0", "north at 5", "south at 5"]
