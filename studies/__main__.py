"""``python -m studies NAME [ARGUMENTS]``."""

import sys

from .command import main

sys.exit(main(sys.argv[1:]))
