"""The page for operators: it has every alarm, and its unit is one of systemd."""

import ast
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.nodes.common import health as common

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "operations.md").read_text()
UNIT = ROOT / "config" / "systemd" / "phd_jdtc_ros@.service"
NODES = Path(common.__file__).parents[1]


def alarms():
    """Yield the words of the conditions in the nodes' health that are not OK, without values."""
    for path in NODES.rglob("*.py"):
        for call in ast.walk(ast.parse(path.read_text())):
            if not isinstance(call, ast.Call):
                continue
            name, conditions = getattr(call.func, "id", ""), []
            if name == "first":
                conditions = [each.elts for each in call.args if isinstance(each, ast.Tuple)]
            elif name == "Condition":
                conditions = [call.args]
            for level, *_, text in conditions:
                if not ast.unparse(level).endswith("OK"):
                    # A text begins behind a quotation mark on the page, what follows a value not.
                    begins = '"' if isinstance(text, ast.Constant) else ""
                    pieces = getattr(text, "values", [text])
                    texts = (each.value for each in pieces if isinstance(each, ast.Constant))
                    yield from (begins + each.strip(" :;,") for each in texts)


def test_operations_page_has_every_alarm_of_the_nodes():
    found = set(alarms())
    assert {'"no scan yet', '"nothing published', "messages lost in the last"} < found
    assert [text for text in found if text not in PAGE] == []


def test_operations_page_has_every_count_of_what_contradicts_the_configuration():
    kinds = {*anomalies._TEXTS, *anomalies._MISSING}
    rows = PAGE.split("| count | do |")[1].split("\n\n")[0]
    assert set(re.findall(r"`(\w+)`(?=[^|]*\| )", rows)) == kinds
    assert kinds >= anomalies.OF_DETECTIONS | anomalies.OF_CLOUDS


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze")
@pytest.mark.parametrize("node", ["tracker", "asterix_bridge"])
def test_unit_is_accepted_by_systemd(tmp_path, node):
    unit = tmp_path / UNIT.name.replace("@", f"@{node}")
    unit.write_text(UNIT.read_text())
    verify = ["systemd-analyze", "verify", "--man=no", str(unit)]
    done = subprocess.run(verify, capture_output=True, text=True, check=False)
    # A fault is a line and no status.
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
