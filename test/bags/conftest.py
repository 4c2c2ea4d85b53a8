import pytest
from small_bags import chunked, made, write

from phd_jdtc_ros.bags.reader import BagReader


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return write(tmp_path_factory.mktemp("bags") / "recording", made())


@pytest.fixture(scope="module")
def original(bag):
    return list(BagReader(bag).messages())


@pytest.fixture(scope="module")
def small_chunks(bag, tmp_path_factory):
    return chunked(tmp_path_factory.mktemp("bags") / "small", bag)
