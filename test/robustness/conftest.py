import sys

import pytest
from forked import Forked

from robustness.harness import rig

MODULE = [sys.executable, "-m", "phd_jdtc_ros"]


@pytest.fixture(autouse=True, scope="package")
def forked_nodes():
    """Start nodes as forks (see `forked`), unless they are to run in a network of their own."""
    launch = rig.launch

    def fork(command, log, environment):
        if [*command[:3]] != MODULE:
            return launch(command, log, environment)
        return Forked(command[3], command[4:], log, environment)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rig, "launch", fork)
        yield
