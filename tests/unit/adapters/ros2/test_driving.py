"""A robot with Nav2 drives its released way in straight lines, and stands where it is told to."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.ros2.driving import (
    REJECTIONS,
    CancelNavigation,
    CancelRefused,
    Disabled,
    DoesNotHeed,
    Driving,
    Effect,
    EnterLevel,
    GoalUnderWay,
    HaltWanted,
    HasGivenUp,
    HasHalted,
    HasPassed,
    Input,
    LevelEntered,
    MotionKnown,
    Navigate,
    NavigationEnded,
    NavigatorPresent,
    PoseKnown,
    RetryDue,
    RetryLater,
    WayChanged,
)
from somrs.adapters.ros2.frames import Pose
from somrs.adapters.ros2.lines import GoalStatus
from somrs.devices.road_robot import Way, Waypoint


def _way(*points: tuple[float, float], released: int | None = None, first: int = 0, level: float = 0.0) -> Way:
    return tuple(
        Waypoint(number=first + n, name=f"P{first + n}", x=x, y=y, level=level, released=released is None or n < released)
        for n, (x, y) in enumerate(points)
    )


def _driving(*inputs: Input, turns: bool = False) -> Driving:
    driving = Driving("Robot1", corridor=0.5, level=0.0, turns=turns)
    driving.handle(NavigatorPresent(True))
    driving.handle(PoseKnown(Pose(0.0, 0.0, 0.0)))
    for input in inputs:
        driving.handle(input)
    return driving


CORNER = _way((0, 0), (1, 0), (2, 0), (2, 1))


def test_a_goal_is_the_end_of_the_straight_line_ahead() -> None:
    (effect,) = _driving().handle(WayChanged(CORNER))
    assert isinstance(effect, Navigate)
    assert (effect.waypoint.name, effect.yaws) == ("P2", (0.0,))


def test_the_corner_is_driven_when_the_robot_has_come_to_it() -> None:
    driving = _driving(WayChanged(CORNER))
    passed_first, passed_second, effect = driving.handle(NavigationEnded(1, GoalStatus.SUCCEEDED))
    assert (passed_first, passed_second) == (HasPassed(1), HasPassed(2))
    assert isinstance(effect, Navigate)
    assert (effect.waypoint.name, effect.yaws) == ("P3", (math.pi / 2,))


def test_a_robot_has_passed_the_waypoints_that_it_has_driven_past() -> None:
    driving = _driving(WayChanged(CORNER))
    assert driving.handle(PoseKnown(Pose(0.9, 0.0, 0.0))) == []
    assert driving.handle(PoseKnown(Pose(1.1, 0.0, 0.0))) == [HasPassed(1)]
    assert driving.handle(PoseKnown(Pose(2.0, 0.0, 0.0))) == []
    assert driving.handle(NavigationEnded(1, GoalStatus.SUCCEEDED))[0] == HasPassed(2)


def test_a_longer_line_replaces_the_goal_without_a_stop() -> None:
    driving = _driving(WayChanged(_way((0, 0), (1, 0), (2, 0), released=2)))
    (effect,) = driving.handle(WayChanged(_way((0, 0), (1, 0), (2, 0))))
    assert isinstance(effect, Navigate)
    assert effect.waypoint.name == "P2"
    assert driving.handle(NavigationEnded(1, GoalStatus.ABORTED)) == []
    assert HasPassed(2) in driving.handle(NavigationEnded(2, GoalStatus.SUCCEEDED))


def test_what_is_not_released_is_no_goal() -> None:
    driving = _driving()
    assert driving.handle(WayChanged(_way((0, 0), (1, 0), released=1))) == []


def test_a_navigation_that_gives_up_ends_the_way() -> None:
    driving = _driving(WayChanged(CORNER))
    (effect,) = driving.handle(NavigationEnded(1, GoalStatus.ABORTED, "no valid path (208)"))
    assert effect == HasGivenUp("the navigation of Robot1 aborted the goal P2: no valid path (208)")
    assert [type(effect) for effect in driving.handle(WayChanged(CORNER))] == [Navigate]


def test_a_robot_halts_when_its_goals_have_ended_and_it_does_not_move() -> None:
    driving = _driving(WayChanged(_way((0, 0), (1, 0), released=2)), WayChanged(_way((0, 0), (1, 0), (2, 0))), MotionKnown(True))
    assert driving.handle(HaltWanted()) == [CancelNavigation(1), CancelNavigation(2)]
    assert driving.handle(NavigationEnded(1, GoalStatus.ABORTED)) == []
    assert driving.handle(NavigationEnded(2, GoalStatus.CANCELED)) == []
    assert driving.handle(MotionKnown(False)) == [HasHalted()]


def test_a_replaced_goal_that_goes_on_is_cancelled_when_the_next_is_rejected() -> None:
    driving = _driving(WayChanged(_way((0, 0), (1, 0), released=2)), WayChanged(_way((0, 0), (1, 0), (2, 0))))
    assert driving.handle(NavigationEnded(2, GoalStatus.REJECTED, "poze: there is no such field")) == [CancelNavigation(1)]
    assert [type(effect) for effect in driving.handle(NavigationEnded(1, GoalStatus.CANCELED))] == [HasGivenUp]


def test_a_goal_that_is_rejected_is_sent_again_until_the_navigation_is_ready() -> None:
    """Seen with a Nav2 that was not ready: five goals were rejected within 8 s, and the task failed."""
    driving = _driving(WayChanged(CORNER))
    effects = driving.handle(NavigationEnded(1, GoalStatus.REJECTED))
    assert effects == [DoesNotHeed("the navigation of Robot1 rejects its goal P2; it is asked again"), RetryLater()]
    assert driving.handle(WayChanged(CORNER)) == []
    (effect,) = driving.handle(RetryDue())
    assert isinstance(effect, Navigate)
    assert driving.handle(GoalUnderWay()) == [DoesNotHeed(None)]
    assert driving.handle(GoalUnderWay()) == []


def test_a_goal_that_is_always_rejected_ends_the_way() -> None:
    driving = _driving(WayChanged(CORNER))
    effects: list[Effect] = []
    for goal in range(1, REJECTIONS + 2):
        effects += driving.handle(NavigationEnded(goal, GoalStatus.REJECTED))
        effects += driving.handle(RetryDue())
    assert [effect for effect in effects if isinstance(effect, HasGivenUp)] == [
        HasGivenUp("the navigation of Robot1 rejected the goal P2"),
    ]
    assert effects[-2] == DoesNotHeed(None)


def test_a_robot_whose_goal_is_rejected_can_be_halted() -> None:
    driving = _driving(WayChanged(CORNER), NavigationEnded(1, GoalStatus.REJECTED))
    assert driving.handle(HaltWanted()) == [DoesNotHeed(None), HasHalted()]
    assert driving.handle(RetryDue()) == []


def test_a_navigation_that_is_started_again_gets_its_goal_again() -> None:
    driving = _driving(WayChanged(CORNER))
    assert driving.handle(NavigationEnded(1, GoalStatus.LOST)) == []
    assert driving.handle(NavigatorPresent(False)) == []
    (effect,) = driving.handle(NavigatorPresent(True))
    assert isinstance(effect, Navigate)
    assert (effect.goal, effect.waypoint.name) == (2, "P2")


def test_a_robot_that_cannot_be_reached_has_not_halted_yet() -> None:
    driving = _driving(WayChanged(CORNER), NavigationEnded(1, GoalStatus.LOST), NavigatorPresent(False))
    assert driving.handle(HaltWanted()) == []
    assert driving.handle(NavigatorPresent(True)) == [HasHalted()]


def test_a_robot_that_leaves_its_way_is_stopped() -> None:
    driving = _driving(WayChanged(CORNER))
    assert driving.handle(PoseKnown(Pose(0.5, 0.4, 0.0))) == []
    assert driving.handle(PoseKnown(Pose(0.6, 0.7, 0.0))) == [CancelNavigation(1)]
    (effect,) = driving.handle(NavigationEnded(1, GoalStatus.CANCELED))
    assert isinstance(effect, HasGivenUp)
    assert "left its way to P2 by more than 0.5 m" in effect.description


def test_a_robot_that_refuses_to_cancel_is_followed_to_its_goal_and_has_not_halted_before() -> None:
    driving = _driving(WayChanged(_way((0, 0), (1, 0), (2, 0))), MotionKnown(True))
    assert driving.handle(HaltWanted()) == [CancelNavigation(1)]
    (effect,) = driving.handle(CancelRefused(1))
    assert isinstance(effect, DoesNotHeed)
    assert effect.description == "Robot1 does not stop: it does not cancel its goal P2, and is expected there"
    assert driving.handle(CancelRefused(1)) == []  # asked again, it refuses again
    assert driving.handle(PoseKnown(Pose(1.2, 0.0, 0.0))) == [HasPassed(1)]
    assert driving.handle(NavigationEnded(1, GoalStatus.SUCCEEDED)) == [DoesNotHeed(None), HasPassed(2)]
    assert driving.handle(MotionKnown(False)) == [HasHalted()]


def test_a_robot_with_a_fault_does_not_drive_on_when_it_is_mended() -> None:
    driving = _driving(WayChanged(CORNER))
    assert driving.handle(Disabled(True)) == [CancelNavigation(1)]
    assert driving.handle(Disabled(False)) == []
    assert driving.handle(NavigationEnded(1, GoalStatus.CANCELED)) == []
    assert [type(effect) for effect in driving.handle(WayChanged(CORNER))] == [Navigate]


def test_a_robot_with_a_fault_is_not_sent_anywhere() -> None:
    driving = _driving(Disabled(True))
    assert driving.handle(WayChanged(CORNER)) == []
    assert [type(effect) for effect in driving.handle(Disabled(False))] == [Navigate]


def test_a_goal_with_poses_leads_around_corners() -> None:
    (effect,) = _driving(turns=True).handle(WayChanged(CORNER))
    assert isinstance(effect, Navigate)
    assert [waypoint.name for waypoint in effect.way] == ["P1", "P2", "P3"]
    assert effect.yaws == (0.0, 0.0, math.pi / 2)


def test_a_robot_that_cuts_a_corner_has_passed_it_when_it_is_nearer_to_the_next_line() -> None:
    driving = _driving(WayChanged(CORNER), PoseKnown(Pose(1.5, 0.0, 0.0)), turns=True)
    assert driving.handle(PoseKnown(Pose(1.7, 0.2, 0.0))) == []
    assert driving.handle(PoseKnown(Pose(1.85, 0.3, 0.0))) == [HasPassed(2)]


def test_a_robot_that_cuts_a_corner_by_more_than_its_corridor_is_stopped() -> None:
    driving = _driving(WayChanged(_way((0, 0), (4, 0), (4, 4))), turns=True)
    assert driving.handle(PoseKnown(Pose(2.0, 1.0, 0.0))) == [CancelNavigation(1)]


def test_another_floor_has_another_map() -> None:
    ride = (*_way((0, 0), (1, 0)), *_way((1, 0), (2, 0), first=2, level=3.0))
    driving = _driving(WayChanged(ride))
    assert driving.handle(NavigationEnded(1, GoalStatus.SUCCEEDED)) == [HasPassed(1), EnterLevel(ride[2])]
    passed, effect = driving.handle(LevelEntered(3.0))
    assert passed == HasPassed(2)
    assert isinstance(effect, Navigate)
    assert effect.waypoint.name == "P3"


def test_a_floor_without_a_map_ends_the_way() -> None:
    ride = (*_way((0, 0)), *_way((0, 0), first=1, level=3.0))
    driving = _driving(WayChanged(ride))
    assert driving.handle(LevelEntered(3.0, "no map of the floor at 3 m")) == [HasGivenUp("no map of the floor at 3 m")]


POINTS = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=2, max_size=8).map(
    lambda points: [point for n, point in enumerate(points) if n == 0 or point != points[n - 1]]
)


@given(points=POINTS, choices=st.lists(st.sampled_from(["release", "drive", "lose", "halt"]), max_size=40), turns=st.booleans())
def test_whatever_happens_a_robot_is_sent_to_released_waypoints_only_and_passes_each_once(
    points: list[tuple[float, float]], choices: list[str], turns: bool
) -> None:
    driving = Driving("Robot1", corridor=0.5, level=0.0, turns=turns)
    released, passed, goals, halted = 1, [0], list[Navigate](), 0
    inputs: list[Input] = [NavigatorPresent(True), PoseKnown(Pose(*points[0], 0.0)), WayChanged(_way(*points, released=1))]
    for choice in [*choices, "drive"]:
        if choice == "release":
            released = min(released + 1, len(points))
            inputs.append(WayChanged(_way(*points, released=released)[passed[-1] :]))
        elif choice == "drive" and goals:
            inputs += [PoseKnown(Pose(goals[-1].waypoint.x, goals[-1].waypoint.y, 0.0))]
            inputs += [*(NavigationEnded(goal.goal, GoalStatus.ABORTED) for goal in goals[:-1])]
            inputs += [NavigationEnded(goals[-1].goal, GoalStatus.SUCCEEDED)]
        elif choice == "lose":
            inputs += [*(NavigationEnded(goal.goal, GoalStatus.LOST) for goal in goals), NavigatorPresent(False), NavigatorPresent(True)]
        elif choice == "halt":
            halted -= 1
            inputs += [HaltWanted(), *(NavigationEnded(goal.goal, GoalStatus.CANCELED) for goal in goals)]
        for input in inputs:
            for effect in driving.handle(input):
                if isinstance(effect, Navigate):
                    assert effect.waypoint.number < released
                    goals.append(effect)
                elif isinstance(effect, HasPassed):
                    passed.append(effect.number)
                assert not isinstance(effect, HasGivenUp)
                halted += isinstance(effect, HasHalted)
        inputs = []
    assert passed == [*range(len(passed))]
    assert halted == 0
