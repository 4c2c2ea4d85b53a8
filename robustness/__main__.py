"""``python -m robustness faults | soak | fuzz``."""

import sys

from .rig import environment

# Before anything imports rclpy.
environment()

from .command import main  # noqa: E402

sys.exit(main(sys.argv[1:]))
