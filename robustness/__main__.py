"""``python -m robustness faults | soak | fuzz``."""

import os
import sys

from .harness.isolation import ISOLATED

# Before rclpy is imported: the shipped profile keeps the traffic of this process and its children
# on this machine, and they leave no shared memory behind when killed. With the discovery range
# LOCALHOST in addition, a restarted node would be discovered seconds later.
os.environ.update(ISOLATED)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"

from .command import main

sys.exit(main(sys.argv[1:]))
