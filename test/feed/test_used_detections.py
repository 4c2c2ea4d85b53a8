from phd_jdtc_ros.feed.used_detections import UsedDetections


def test_half_is_enough():
    used = UsedDetections()
    used.read(5, {"range": 5})
    assert used.fault() is None


def test_less_than_half_is_reported_with_the_main_reasons_and_their_parameters():
    used = UsedDetections()
    used.read(20, {"range": 10, "azimuth": 1, "not_finite": 2})
    used.refuse("late", 9)
    used.unreadable("schema")
    assert used.fault() == (
        "11 of 34 detections could be used; dropped most by: range 10 (max_range), late 9 "
        "(reorder_s, late_reports), not_finite 2 (fields)"
    )


def test_report_that_waited_for_a_pose_in_vain_counts_with_its_detections():
    used = UsedDetections()
    for _ in range(4):
        used.read(10, {})
    used.lose_reports({"pose_missing": 3})
    assert used.lost == {"pose_missing": 30}


def test_nothing_at_all_is_no_fault():
    assert UsedDetections().fault() is None
