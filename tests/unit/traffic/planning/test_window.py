"""Plans for a while ahead, made anew again and again."""

from __future__ import annotations

from itertools import pairwise
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from somrs.traffic.planning.barriers import Barrier
from somrs.traffic.planning.graph import FAR, Graph, PrivatePlace
from somrs.traffic.planning.pibt import Configuration, Goals
from somrs.traffic.planning.window import Traveller, WindowPlanner
from tests.support.examples import examples
from tests.support.roadmaps import configurations, graphs, grid, is_possible, shortest_course


@examples(100)
@given(st.data(), graphs(6), st.integers(1, 4))
def test_all_robots_come_to_their_goals_if_they_can(data: st.DataObject, graph: Graph, steps: int) -> None:
    places = data.draw(configurations(graph, 3))
    goals: Goals = [data.draw(st.none() | st.integers(0, graph.size - 1)) for _ in places]
    if shortest_course(graph, places, goals, rotations=False) is not None:
        assert plan_until_all_were_there(graph, places, goals, steps) < 200


def plan_until_all_were_there(graph: Graph, places: Configuration, goals: Goals, steps: int) -> int:
    """The number of plans, each followed to its end, until every robot has been at its goal; 200 if it takes more."""
    planner, missing = WindowPlanner(graph, Random(0).shuffle), {robot for robot, goal in enumerate(goals) if goal is not None}
    nearest, waiting = [FAR] * len(places), [0.5 - robot / 100 for robot in range(len(places))]
    for count in range(200):
        travellers = [
            Traveller(place=place, goal=goal, waiting=waited, nearest=near)
            for place, goal, waited, near in zip(places, goals, waiting, nearest, strict=True)
        ]
        course = planner.plan(travellers, steps).steps
        assert all(is_possible(graph, before, after, rotations=False) for before, after in pairwise(course))
        for robot, goal in enumerate(goals):
            if goal is not None:
                nearest[robot] = min(nearest[robot], *(graph.distances(goal)[configuration[robot]] for configuration in course))
                waiting[robot] += len(course)
        missing -= {robot for robot in missing if nearest[robot] == 0}
        places = course[-1]
        if not missing:
            return count
    return 200


@examples(100)
@given(st.data(), graphs(6))
def test_a_robot_is_stuck_only_if_there_are_no_ways(data: st.DataObject, graph: Graph) -> None:
    places = data.draw(configurations(graph, 3))
    goals: Goals = [data.draw(st.none() | st.integers(0, graph.size - 1)) for _ in places]
    for robot in WindowPlanner(graph, Random(0).shuffle).plan(travellers(places, goals), 10).stuck:
        aim: Goals = [goal if number == robot else None for number, goal in enumerate(goals)]
        assert shortest_course(graph, places, aim, rotations=False) is None


def test_a_robot_that_is_shut_in_keeps_another_one_from_its_goal_however_many_others_there_are() -> None:
    side = 10
    hall = [(y * side + x, y * side + x + step) for y in range(side) for x, step in ((x, step) for x in range(side) for step in (1, side))]
    lanes = [(start, end) for start, end in hall if end < side * side and (end == start + side or end % side)]
    shut_in, goal = side * side, side * side + 1
    graph = Graph(side * side + 2, [(a, b, 1.0) for lane in [*lanes, (0, goal)] for a, b in (lane, lane[::-1])], [(shut_in, goal)])
    places = (shut_in, *range(9, 89, 10))
    waiting = Traveller(place=0, goal=goal, nearest=graph.distance(0, goal))  # it has come as near as it can
    others = travellers(places, [None] * len(places))
    assert WindowPlanner(graph, Random(0).shuffle).plan([waiting, *others], 20).stuck == {0: Barrier(robots=(1,))}


def test_two_robots_do_not_step_aside_for_each_other_for_ever() -> None:
    """PIBT alone moves both to and fro: the one that is at its goal comes back to it each time."""
    graph, named = grid("A...B.C", "#####D#")
    assert plan_until_all_were_there(graph, (named["A"], named["B"]), (named["B"], named["A"]), 2) < 20


def travellers(places: Configuration, goals: Goals) -> list[Traveller]:
    return [Traveller(place=place, goal=goal) for place, goal in zip(places, goals, strict=True)]


def test_a_robot_without_a_way_does_not_keep_the_others() -> None:
    graph = Graph(5, [(0, 1, 1.0), (1, 0, 1.0), (1, 2, 1.0), (2, 1, 1.0), (3, 4, 1.0)])
    assert graph.distances(0)[4] == FAR
    assert WindowPlanner(graph, Random(0).shuffle).plan(travellers((4, 0), (0, 2)), 4).steps[-1] == (4, 2)


def test_a_robot_that_stands_in_a_dead_end_is_passed_by() -> None:
    graph, named = grid("A.B.", "##C#")
    course = WindowPlanner(graph, Random(0).shuffle).plan(travellers((named["A"], named["C"]), (named["B"], None)), 4).steps
    assert course[-1] == (named["B"], named["C"])


def test_who_stands_where_another_wants_to_makes_room_while_others_are_under_way() -> None:
    """Two berths beside a place: from the one, a robot has to be out before another can come into the other. The others move all the time,
    so that nothing is searched for."""
    public, named = grid("ABCDEFGH", "........")
    beside = tuple((named[name], 1.0) for name in "BC")
    graph = public.with_private(
        [PrivatePlace(0, beside, (named["B"], public.size + 1)), PrivatePlace(1, beside, (named["B"], public.size))]
    )
    parked, wanted = public.size, public.size + 1
    places: Configuration = parked, named["C"], named["H"]
    planner, oncoming = WindowPlanner(graph, Random(0).shuffle), named["G"]
    for _ in range(20):
        goals: Goals = [None, wanted, oncoming]
        places = planner.plan(travellers(places, goals), 4, effort=0).steps[-1]
        oncoming = named["H"] if places[2] == named["G"] else named["G"]
        if places[1] == wanted:
            return
    raise AssertionError(f"it never came there: {places}")


def test_who_is_held_up_drives_round_one_that_stands_in_its_way() -> None:
    """Beside the way is a berth from which nobody gets out while another one is before it. The way through the lower row is longer."""
    public, named = grid("ABCDE", ".....")
    graph = public.with_private([PrivatePlace(1, ((named["C"], 1.0),), (named["C"],))])
    robots = [Traveller(place=named["B"], goal=named["E"], waiting=9.0, nearest=3.0, held_up=True), Traveller(place=public.size)]
    course = WindowPlanner(graph, Random(0).shuffle).plan(robots, 8, effort=0).steps
    assert course[-1] == (named["E"], public.size)


def test_who_stands_in_the_only_way_gets_out_past_one_that_is_held_up_there() -> None:
    """The way out of the berth leads through where the other one waits, which has to go back first."""
    public, named = grid("..ABCDE", "....F..")
    graph = public.with_private([PrivatePlace(1, ((named["B"], 1.0),), (named["C"], named["F"]))])
    places: Configuration = named["B"], public.size
    planner = WindowPlanner(graph, Random(0).shuffle)
    for _ in range(5):
        robots = [Traveller(place=places[0], goal=named["E"], waiting=9.0, nearest=3.0, held_up=True), Traveller(place=places[1])]
        places = planner.plan(robots, 4, effort=0).steps[-1]
        if places[0] == named["E"]:
            return
    raise AssertionError(f"it never came there: {places}")
