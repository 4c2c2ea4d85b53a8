import pytest

from phd_jdtc_ros.core import backend as backends


@pytest.fixture(params=["numpy", "numba"])
def backend(request):
    """Run a test with the plain and with the compiled kernels."""
    if request.param == "numba":
        pytest.importorskip("numba", reason="numba is missing: pip install numba")
    with backends.using(request.param):
        yield
