"""``python -m benchmarks``."""

import sys

from phd_jdtc_ros.threads import use_one_thread

use_one_thread()

from .command import main

sys.exit(main(sys.argv[1:]))
