"""Which step of the positions is that of a reset that the vehicle tells of."""

from companion.told_resets import ToldResets


def test_the_largest_step_since_the_count_before_is_that_of_the_reset() -> None:
    resets = ToldResets()
    for step in ((0.2, 0.0, 0.0), (1.0, 0.0, -0.5), (0.0, 0.3, 0.0)):
        assert not resets.step(step)
    assert resets.told(reset=True) == (1.0, 0.0, -0.5) and not resets.due
    assert resets.told(reset=False) is None, "it is told of once"


def test_where_the_count_comes_sooner_the_next_step_is_that_of_the_reset() -> None:
    resets = ToldResets()
    assert not resets.step((0.05, 0.0, 0.0)), "noise"
    assert resets.told(reset=True) is None and resets.due
    assert not resets.step((0.05, 0.0, 0.0)) and resets.step((0.5, 0.0, 0.0))
    resets.believed()
    assert not resets.step((0.5, 0.0, 0.0))


def test_after_a_jump_that_was_followed_no_step_is_followed_once_more() -> None:
    resets = ToldResets()
    resets.step((1.0, 0.0, 0.0))
    resets.followed()
    resets.step((0.0, 0.4, 0.0))
    assert resets.told(reset=True) is None and not resets.due
