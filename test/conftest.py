import os

from robustness.harness.isolation import ISOLATED

# Before anything imports rclpy: tests talk on this machine only, apart from other ROS processes, by
# the shipped profile. With a discovery range besides, a restarted node is found only after seconds.
os.environ.update(ISOLATED)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"
# Before anything imports numpy: with others beside them, the threads of a BLAS mostly wait for one
# another, and busily. The processes that tests start inherit it.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

from robustness.harness.domains import Domain

# Never released: it is this process's until that ends.
os.environ["ROS_DOMAIN_ID"] = str(Domain().number)

import live_files
import pytest
from hypothesis import settings

# A gate gives the same answer to the same commit; elsewhere every run draws other examples.
settings.register_profile("project", deadline=None, derandomize="CI" in os.environ)
settings.load_profile("project")


def pytest_collection_modifyitems(items):
    """Mark tests whose fixtures start nodes or talk to them as live."""
    for item in items:
        # A launch test has no fixtures.
        if live_files.FIXTURES & {*getattr(item, "fixturenames", ())}:
            item.add_marker(pytest.mark.live)
        if item.get_closest_marker("live") and not live_files.names_live_tests(item.path):
            raise pytest.UsageError(f"{item.nodeid}: run.py does not find this live test")
