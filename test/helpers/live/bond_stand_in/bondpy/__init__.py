"""In place of the package of this name, whose messages are not on PyPI; see `bondpy`."""
