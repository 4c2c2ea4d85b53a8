"""``python -m benchmarks``: on one thread, which must be set before numpy is imported."""

import os
import sys

from .gate import ONE_THREAD

os.environ.update(ONE_THREAD)

from .command import main

sys.exit(main(sys.argv[1:]))
