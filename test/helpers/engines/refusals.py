"""The faults with which a configuration is refused."""

import pytest

from phd_jdtc_ros.configuration.schema import ConfigError


def faults_of(function, *arguments):
    """Return the faults, one line each, with which a function refuses its arguments."""
    with pytest.raises(ConfigError) as caught:
        function(*arguments)
    assert all("\n" not in fault for fault in caught.value.faults)
    return list(caught.value.faults)
