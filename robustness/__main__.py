"""``python -m robustness faults | soak | fuzz``."""

import os
import sys

# Before anything imports rclpy: this process and its children stay on this machine, and leave no
# shared memory behind where they are killed.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"
os.environ["OMP_NUM_THREADS"] = "1"

from .command import main

sys.exit(main(sys.argv[1:]))
