from msg_adapters import outputs
from phd_jdtc_ros.configuration import tracker_node

# Switches of what is no row of the table: the radars' frames, and a status of the diagnostics.
OTHERS = {"frames", "registration"}


def switches(rows):
    return {row.switch for row in rows if row.switch}


def test_every_switch_of_the_table_is_an_output_that_users_can_name():
    assert switches(outputs.table(1)) == {*tracker_node.OUTPUTS} - OTHERS


def test_the_usual_rows_of_the_table_are_on_by_default():
    usual = {row for row in outputs.table(1) if row.usual}
    assert switches(usual) == {*tracker_node.Node().outputs} - OTHERS


def test_a_switch_is_for_usual_or_for_unusual_rows():
    rows = outputs.table(1)
    usual = switches(row for row in rows if row.usual)
    assert not usual & switches(row for row in rows if not row.usual)
