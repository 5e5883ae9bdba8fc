"""Who may have what, who waits for whom, and who has lost what."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from somrs.kernel.codec import Codec, encode
from somrs.kernel.reservations import LEASE, MOST_OVERTAKINGS, Claimant, Denied, Granted, Reservation, Reservations
from somrs.protocol.messages.reservations import ReservationMode
from somrs.protocol.messages.waits import Holder, WaitsForTasks

TRY, WAIT, UNDO, ASK = ReservationMode


def make_reservation(changes: str = "", relies: str = "") -> Reservation:
    return Reservation(changes=frozenset(changes), relies_on=frozenset(relies))


def claimant(priority: int = 0, goal: str = "", holder: str = "tm") -> Claimant:
    return Claimant(holder=holder, goal=goal, priority=priority, arrival=0)


def reserve(
    tasks: Reservations,
    task: str,
    changes: str = "",
    relies: str = "",
    mode: ReservationMode = TRY,
    priority: int = 0,
    now: float = 0.0,
    holder: str = "tm",
) -> Granted | Denied:
    return tasks.reserve(task, claimant(priority, f"goal of {task}", holder), make_reservation(changes, relies), mode, now)


def held(tasks: Reservations, task: str) -> Reservation:
    return tasks.claimants[task].held


@pytest.mark.parametrize(
    ("first", "second", "contested"),
    [
        (make_reservation("ab"), make_reservation("bc"), "b"),
        (make_reservation("ab"), make_reservation("", "bc"), "b"),
        (make_reservation("", "ab"), make_reservation("bc"), "b"),
        (make_reservation("", "ab"), make_reservation("", "bc"), ""),
        (make_reservation("a", "b"), make_reservation("b", "a"), "ab"),
        (make_reservation("a"), make_reservation("b"), ""),
    ],
)
def test_what_one_changes_the_other_neither_changes_nor_relies_on(first: Reservation, second: Reservation, contested: str) -> None:
    assert first.overlap(second) == frozenset(contested)
    assert second.overlap(first) == frozenset(contested)


def test_reservations_are_put_together_and_taken_apart() -> None:
    assert make_reservation("a", "b") | make_reservation("c", "d") == make_reservation("ac", "bd")
    assert make_reservation("abc", "de").without("ad") == make_reservation("bc", "e")
    assert make_reservation("ab", "c").includes(make_reservation("a", "bc"))
    assert not make_reservation("ab", "c").includes(make_reservation("c"))
    assert not make_reservation()


def test_the_objects_that_others_have_are_named_once_in_order() -> None:
    tasks = Reservations()
    reserve(tasks, "one", "bc")
    reserve(tasks, "two", "ab", mode=WAIT)
    holders = tasks.describe({"one": frozenset("cb"), "two": frozenset("ab")})
    assert holders == (
        Holder(task="one", goal="goal of one", objects=("b", "c")),
        Holder(task="two", goal="goal of two", objects=("a", "b"), waiting=True),
    )
    assert WaitsForTasks.on(holders).objects == ("a", "b", "c")


def test_a_task_gets_what_nobody_has_and_is_denied_the_rest_whole() -> None:
    tasks = Reservations()
    assert reserve(tasks, "a", "x", "y") == Granted(fence=1)
    assert reserve(tasks, "b", "z", "y") == Granted(fence=2)
    assert reserve(tasks, "c", "xw") == Denied(holders=(Holder(task="a", goal="goal of a", objects=("x",)),))
    assert not held(tasks, "c"), "it is all or nothing"
    assert reserve(tasks, "a", "v") == Granted(fence=1), "what it adds has the number that it had"
    assert held(tasks, "a") == make_reservation("xv", "y")
    tasks.release("a")
    assert reserve(tasks, "a", "x") == Granted(fence=3), "what it gets again has another one"
    assert not tasks.is_held("a", 1)
    assert tasks.is_held("a", 3)


def test_who_only_asks_gets_nothing_and_leaves_nothing() -> None:
    tasks = Reservations()
    reserve(tasks, "a", "x")
    assert isinstance(reserve(tasks, "b", "x", mode=ASK), Denied)
    assert reserve(tasks, "b", "y", mode=ASK) == Granted(fence=0)
    assert [*tasks.claimants] == ["a"]


def test_who_waits_gives_up_what_it_had_and_is_called_when_nobody_has_what_it_wants() -> None:
    tasks = Reservations()
    reserve(tasks, "a", "x")
    reserve(tasks, "b", "y")
    assert isinstance(reserve(tasks, "c", "y", mode=WAIT), Denied)
    assert reserve(tasks, "b", "x", mode=WAIT) == Denied(holders=(Holder(task="a", goal="goal of a", objects=("x",)),), waits=True)
    assert not held(tasks, "b")
    assert [*tasks.admit_waiting(0)] == ["c"]
    tasks.remove("a")
    assert [*tasks.admit_waiting(0)] == ["b"]
    assert [*tasks.admit_waiting(0)] == [], "nobody is called twice for the same"
    assert isinstance(reserve(tasks, "d", "x"), Denied), "until it has made its plan, what it waits for is kept for it"
    assert reserve(tasks, "b", "x") == Granted(fence=3)


def test_of_those_that_wait_the_more_urgent_comes_first_and_then_the_one_that_asked_first() -> None:
    tasks = Reservations()
    reserve(tasks, "holder", "x")
    for name, priority in (("a", 0), ("b", 1), ("c", 0), ("d", 1), ("e", -1)):
        reserve(tasks, name, "x", mode=WAIT, priority=priority)
    order = []
    leaving = "holder"
    for _ in range(5):
        tasks.remove(leaving)
        (leaving,) = tasks.admit_waiting(0)
        order.append(leaving)
    assert order == ["b", "d", "a", "c", "e"]


def test_later_and_more_urgent_tasks_do_not_overtake_for_ever() -> None:
    tasks = Reservations()
    reserve(tasks, "urgent0", "x", priority=1)
    reserve(tasks, "patient", "x", mode=WAIT)
    number = 0
    while number < 100:
        number += 1
        reserve(tasks, f"urgent{number}", "x", mode=WAIT, priority=1)
        tasks.remove(f"urgent{number - 1}")
        (called,) = tasks.admit_waiting(0)
        assert isinstance(reserve(tasks, called, "x"), Granted)
        if called == "patient":
            break
    assert number == MOST_OVERTAKINGS + 1


def test_to_undo_work_a_task_gets_what_nobody_else_has_whoever_waits() -> None:
    tasks = Reservations()
    reserve(tasks, "a", "xy")
    tasks.release("a")
    reserve(tasks, "b", "x")
    reserve(tasks, "c", "xy", mode=WAIT, priority=5)
    granted = reserve(tasks, "a", "xy", mode=UNDO)
    assert granted == Granted(fence=3, holders=(Holder(task="b", goal="goal of b", objects=("x",)),))
    assert held(tasks, "a") == make_reservation("y")


def test_what_another_changed_that_had_it_since_is_known_to_the_one_that_had_it_before() -> None:
    tasks = Reservations()
    reserve(tasks, "a", "xyz")
    tasks.note_changes("a", "x")
    assert tasks.claimants["a"].overtaken == frozenset()
    tasks.release("a")
    reserve(tasks, "b", "x", "y")
    tasks.note_changes("b", "xyz")
    tasks.note_changes("nobody", "z")
    tasks.remove("b")
    assert reserve(tasks, "a", "xyz") == Granted(fence=3, overtaken=frozenset("x"))
    assert reserve(tasks, "a", "w") == Granted(fence=3), "what it does from then on is its own"


def test_after_its_lease_a_reservation_gives_way_to_others_but_only_if_they_want_it() -> None:
    tasks = Reservations(heard_at={"tm-a": 0.0, "tm-b": 0.0})
    reserve(tasks, "a", "x", holder="tm-a")
    reserve(tasks, "a2", "v", holder="tm-a")
    assert isinstance(reserve(tasks, "b", "x", mode=WAIT, holder="tm-b", now=LEASE - 1), Denied)
    assert tasks.next_lapse(LEASE - 1) == LEASE
    tasks.heard_at["tm-b"] = LEASE
    tasks.lapse()
    assert [*tasks.admit_waiting(LEASE)] == ["b"]
    assert tasks.is_held("a", 1), "so far, nobody has taken it"
    granted = reserve(tasks, "b", "x", holder="tm-b", now=LEASE)
    assert granted == Granted(fence=3, lost=(("a", 1),))
    assert not tasks.is_held("a", 1)
    assert tasks.is_held("a2", 2)
    assert tasks.next_lapse(LEASE) is None


def test_a_repository_that_has_forgotten_learns_from_task_managers_who_has_what() -> None:
    tasks = Reservations()
    reserve(tasks, "b", "y")
    restored = claimant()
    restored.held, restored.fence = make_reservation("x"), 7
    assert tasks.restore("a", restored, 0.0) == ()
    assert tasks.is_held("a", 7)
    lost = claimant()
    lost.held, lost.fence = make_reservation("yz"), 4
    assert tasks.restore("c", lost, 0.0) == (Holder(task="b", goal="goal of b", objects=("y",)),)
    assert not held(tasks, "c")
    waiting = claimant()
    waiting.waiting = make_reservation("w")
    assert tasks.restore("d", waiting, 0.0) == ()
    assert [*tasks.admit_waiting(0)] == ["d"]
    assert reserve(tasks, "e", "q") == Granted(fence=8), "no number comes twice"


def test_objects_have_new_names_in_all_that_is_known_of_them() -> None:
    tasks = Reservations()
    reserve(tasks, "a", "x", "y")
    reserve(tasks, "b", "x", mode=WAIT)
    tasks.rename({"x": "X", "y": "Y"})
    assert held(tasks, "a") == make_reservation("X", "Y")
    assert isinstance(reserve(tasks, "c", "X"), Denied)
    tasks.remove("a")
    assert [*tasks.admit_waiting(0)] == ["b"]
    assert isinstance(reserve(tasks, "c", "X"), Denied)


@dataclass
class _Task:
    """What a task should have, by a plain account of what was said to it."""

    held: dict[str, bool] = field(default_factory=dict)
    """Whether it changes the object, or only relies on it."""
    waits: dict[str, bool] | None = None
    is_called: bool = False


OBJECTS = st.dictionaries(st.sampled_from("uvwxyz"), st.booleans(), min_size=1, max_size=4)
TASKS = st.sampled_from([f"task{number}" for number in range(6)])


class ReservationAccount(RuleBasedStateMachine):
    """Tasks that do what they like: at no time do two have one object, unless both only rely on it, and nobody waits for nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.reservations = Reservations()
        self.tasks: dict[str, _Task] = {}
        self.fences: set[int] = set()

    @rule(task=TASKS, wanted=OBJECTS, mode=st.sampled_from(ReservationMode), priority=st.integers(-1, 1))
    def ask(self, task: str, wanted: dict[str, bool], mode: ReservationMode, priority: int) -> None:
        changes = "".join(name for name, is_changed in wanted.items() if is_changed)
        relies = "".join(name for name, is_changed in wanted.items() if not is_changed)
        answer = reserve(self.reservations, task, changes, relies, mode, priority)
        blocking = self._blocking(task, wanted)
        if mode is ASK:
            assert not (blocking and isinstance(answer, Granted))
            return
        known = self.tasks.setdefault(task, _Task())
        if isinstance(answer, Granted):
            assert mode is UNDO or not blocking
            contested = {name for holder in answer.holders for name in holder.objects}
            assert contested == (blocking if mode is UNDO else set())
            if not known.held:
                assert answer.fence not in self.fences
                self.fences.add(answer.fence)
            for name in wanted.keys() - contested:
                known.held[name] = known.held.get(name, False) or wanted[name]
            known.waits, known.is_called = None, False
        elif mode is WAIT:
            assert answer.waits
            known.held, known.waits, known.is_called = {}, wanted, False
        self._call()

    def _blocking(self, task: str, wanted: dict[str, bool]) -> set[str]:
        others = [other.held for name, other in self.tasks.items() if name != task]
        return {name for name, is_changed in wanted.items() for other in others if name in other and (is_changed or other[name])}

    def _call(self) -> None:
        for task in self.reservations.admit_waiting(0.0):
            known = self.tasks[task]
            assert known.waits is not None
            assert not known.is_called
            assert not self._blocking(task, known.waits)
            known.is_called = True

    @rule(task=TASKS)
    def give_up(self, task: str) -> None:
        self.reservations.release(task)
        if task in self.tasks:
            self.tasks[task] = _Task()
        self._call()

    @rule(task=TASKS)
    def end(self, task: str) -> None:
        self.reservations.remove(task)
        self.tasks.pop(task, None)
        self._call()

    @rule()
    def restart(self) -> None:
        self.reservations = Codec[Reservations](Reservations).decode(encode(self.reservations))

    @precondition(lambda self: any(task.waits is not None for task in self.tasks.values()))
    @rule()
    def end_all_that_do_not_wait(self) -> None:
        for name in [name for name, task in self.tasks.items() if task.waits is None]:
            self.end(name)
        assert any(task.is_called for task in self.tasks.values()), "of those that wait for each other only, one goes on"

    @invariant()
    def no_two_tasks_have_one_object(self) -> None:
        for name, task in self.tasks.items():
            assert not self._blocking(name, task.held)


TestReservationAccount = ReservationAccount.TestCase
