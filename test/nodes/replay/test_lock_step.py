from phd_jdtc_ros.nodes.playback import GIVE_UP_S, MAX_OUTSTANDING, PATIENCE_S, LockStep

S = 1_000_000_000


def awaiting(*stamps_s):
    step = LockStep()
    for stamp_s in stamps_s:
        step.expect(stamp_s * S, 0.0)
    return step


def test_an_estimate_answers_its_stamp_and_those_before():
    step = awaiting(6)
    assert not step.may_follow(0.1)
    step.receive(6 * S, 0.2)
    assert step.may_follow(0.2)
    assert step.is_settled(0.2)
    step = awaiting(6, 12, 18)
    step.receive(12 * S, 0.1)
    assert not step.may_follow(0.2)
    step.receive(18 * S, 0.3)
    assert step.may_follow(0.3)
    step = awaiting(12)
    step.receive(6 * S, 0.1)
    assert not step.may_follow(0.2)


def test_a_late_estimate_from_before_a_jump_back_answers_nothing():
    step = awaiting(480)
    step.begin()
    step.expect(6 * S, 1.0)
    step.receive(480 * S, 1.1)
    assert not step.may_follow(1.2)
    step.receive(6 * S, 1.3)
    assert step.may_follow(1.3)


def test_scans_go_on_after_patience_where_estimates_are_held_back():
    step = awaiting(0)
    for stamp_s in range(1, MAX_OUTSTANDING):
        assert not step.may_follow(PATIENCE_S)
        assert step.may_follow(PATIENCE_S + 0.1)
        step.expect(stamp_s * S, PATIENCE_S + 0.1)
    assert not step.may_follow(PATIENCE_S + 0.2)
    step = awaiting(6)
    assert not step.is_settled(PATIENCE_S)
    assert step.is_settled(PATIENCE_S + 0.1)


def test_it_times_out_after_long_without_a_reply_or_a_pause():
    step = awaiting(6, 12)
    step.receive(6 * S, 5.0)
    assert not step.has_timed_out(GIVE_UP_S + 5.0)
    assert step.has_timed_out(GIVE_UP_S + 5.1)
    step.receive(12 * S, GIVE_UP_S + 5.2)
    assert not step.has_timed_out(1000.0)
    step = awaiting(6)
    resumed_s = 10.0 * GIVE_UP_S
    assert step.has_timed_out(resumed_s)
    step.restart(resumed_s)
    assert not step.has_timed_out(resumed_s + GIVE_UP_S)
    assert step.has_timed_out(resumed_s + GIVE_UP_S + 0.1)
    # Other scans may follow: the estimate has been held back all the same.
    assert step.may_follow(resumed_s)


def test_answers_may_be_older_by_the_delay_and_wait_for_other_radars():
    step = LockStep(delay_s=2.0)
    for stamp_s in (4, 8):
        step.expect(stamp_s * S, 0.0)
    step.receive(round(3.9 * S), 0.1)
    assert not step.may_follow(0.2)
    step.receive(round(6.1 * S), 0.3)
    assert step.may_follow(0.3)
    step = LockStep(delay_s=2.5)
    for stamp_s in (10, 11, 12):
        step.expect(stamp_s * S, 0.0)
        assert step.may_follow(0.1)
    step.expect(13 * S, 0.2)
    assert not step.may_follow(0.3)
    step.receive(11 * S, 0.4)
    assert step.may_follow(0.5)
