import pytest

from phd_jdtc_ros.core import backend


@pytest.fixture(params=[backend.NUMPY, backend.NUMBA])
def each_backend(request):
    """Run a test interpreted, and compiled."""
    if request.param == backend.NUMBA:
        pytest.importorskip("numba", reason="numba is optional: pip install '.[fast]'")
    with backend.using(request.param):
        yield request.param
