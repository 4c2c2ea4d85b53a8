import pytest

from msg_adapters.encoding import interfaces, names
from msg_adapters.incoming.readers import READERS
from phd_jdtc_ros.configuration.tables import TABLES


def test_readers_are_what_sensors_may_be_configured_to_send():
    choices = [each for own in TABLES.values() for each in own if each.name == "message"]
    chosen = {name for each in choices for name in each.choices}
    assert chosen == set(READERS)


@pytest.mark.parametrize("name", READERS)
def test_installed_is_a_message_class_of_the_type(name):
    reader = READERS[name]
    found = interfaces.installed_class(reader.type_name)
    if reader.type_name == names.CLOUD:
        assert found is not None
    assert found is None or found.__name__ == reader.type_name.rsplit("/", 1)[1]
