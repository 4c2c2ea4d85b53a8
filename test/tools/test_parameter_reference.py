from pathlib import Path

from phd_jdtc_ros.tools.parameter_reference import page

ROOT = Path(__file__).parents[2]


def test_reference_page_is_up_to_date():
    assert (ROOT / "docs" / "parameters.md").read_text() == page(), "run make parameters"
