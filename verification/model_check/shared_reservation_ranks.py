"""Ranks in place of numbers that only grow, in the model of reservations at two Repositories.

The numbers of a task's messages are doubled on the way to the other Repository (`repository/shared_reserving.py`), and the one before that
of a request is task_serials, too. Ranks keep both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from msgspec import Struct, structs

from somrs.protocol.messages.reservations import Release, ReservationLost, Reserve, Reserved, UnderReservation
from verification.model_check.media import Channel, members
from verification.model_check.reservation_task import TASKS, Answer, Side
from verification.model_check.shared_reservation_state import PassedReport, Reply, RepositoryState, Token, tokens_in


class Ranks:
    """The ranks of all numbers in a state. `messages`: those in transit, by direction; `to_managers`: those to each Task Manager."""

    def __init__(
        self,
        sides: tuple[Side, Side],
        repositories: tuple[RepositoryState, RepositoryState],
        messages: tuple[list[Token], list[Token]],
        to_managers: tuple[tuple[Struct, ...], tuple[Struct, ...]],
    ) -> None:
        fences: tuple[set[int], set[int]] = ({0}, {0})
        serials: tuple[set[int], set[int]] = ({0}, {0})
        for number, (side, repository, neighbour) in enumerate(zip(sides, repositories, repositories[::-1], strict=True)):
            task = TASKS[number]
            task_serials = {side.serial, side.settled, max(side.awaits[0], 0), repository.reservations.last_serial(task)}
            task_serials |= {neighbour.reservations.last_serial(task) // 2} | {int(serial) // 2 for serial in neighbour.replies}
            fences[number].update((side.fence, side.lost))
            fences[number].update(claimant.fence for claimant in repository.reservations.claimants.values())
            fences[number].update(body.fence for body in repository.replies.values() if isinstance(body, Reserved))
            for shared in repository.shared.values():
                fences[1 - number].update((*shared.fences.values(), *shared.lost.values()))
                task_serials |= {shared.request.serial, shared.request.serial - 1} if shared.request is not None else set()
                fences[number].update([shared.granted.fence] if shared.granted is not None else ())
            serials[number].update(serial for serial in task_serials if serial >= 0)
        for number in (0, 1):
            for notice in to_managers[number]:
                match notice:
                    case Answer(serial=serial, body=body):
                        serials[number].add(max(serial, 0))
                        fences[number].update([body.fence] if isinstance(body, Reserved) else ())
                    case ReservationLost(fence=fence):
                        fences[number].add(fence)
            for message in messages[number]:
                match message:
                    case Reserve(serial=serial) | Release(serial=serial):
                        serials[number].update((serial // 2, max(serial // 2 - 1, 0)))
                    case Reply(serial=serial, body=body):
                        serials[1 - number].add(serial // 2)
                        fences[number].update([body.fence] if isinstance(body, Reserved) else ())
                    case ReservationLost(fence=fence):
                        fences[number].add(fence)
                    case PassedReport(reservation=UnderReservation(fence=fence)):
                        fences[1 - number].add(fence)
        self._fences, self._serials = (_ranked(fences[0]), _ranked(fences[1])), (_ranked(serials[0]), _ranked(serials[1]))

    def side(self, side: Side, number: int) -> Side:
        fences, serials = self._fences[number], self._serials[number]
        awaits = (serials[side.awaits[0]] if side.awaits[0] >= 0 else side.awaits[0], side.awaits[1])
        return side._replace(
            fence=fences[side.fence], lost=fences[side.lost], serial=serials[side.serial], settled=serials[side.settled], awaits=awaits,
            sent=max(serials.values()),
        )  # fmt: skip

    def repository(self, state: RepositoryState, number: int) -> RepositoryState:
        """Put ranks into the state of the Repository with this number."""
        reservations, fences = state.reservations, self._fences[number]
        claimants = reservations.claimants
        arrivals = _ranked({claimant.arrival for claimant in claimants.values()} | {0})
        for task, claimant in claimants.items():
            claimant.arrival, claimant.fence = arrivals[claimant.arrival], fences[claimant.fence]
            claimant.serial = self._serial_at(number, task, claimant.serial)
        reservations.arrivals, reservations.fences = len(arrivals) - 1, max(fences.values())
        reservations.ended = {task: self._serial_at(number, task, serial) for task, serial in reservations.ended.items()}
        for shared in state.shared.values():
            shared.fences = {home: self._fences[1 - number][fence] for home, fence in shared.fences.items()}
            shared.lost = {home: self._fences[1 - number][fence] for home, fence in shared.lost.items()}
            if shared.request is not None:
                shared.request = structs.replace(shared.request, serial=self._serials[number][shared.request.serial])
            if shared.granted is not None:
                shared.granted = structs.replace(shared.granted, fence=fences[shared.granted.fence])
        state.replies = {
            str(self._serial_at(number, TASKS[1 - number], int(serial))): self._body(body, number) for serial, body in state.replies.items()
        }
        return state

    def channel(self, channel: Channel, number: int, messages: list[Token], token: Callable[[Token], int]) -> Channel:
        """The channel from the Repository with this number, with ranks in its messages."""
        tokens = {token_before: token(self._message(messages[token_before], number)) for token_before in tokens_in(channel)}
        masks = (sum(1 << tokens[token_before] for token_before in members(mask)) for mask in (channel.unacknowledged, channel.copies))
        return Channel(tuple(tokens[token_before] for token_before in channel.queue), *masks)

    def queue(self, notice: tuple[Struct, ...], number: int) -> tuple[Struct, ...]:
        """What the Task Manager with this number has still to hear, with ranks."""
        return tuple(self._told(body, number) for body in notice)

    def _told(self, notice: Struct, number: int) -> Struct:
        match notice:
            case Answer(serial=serial, body=body):
                return Answer(self._serials[number][serial] if serial >= 0 else serial, self._body(body, number))
            case ReservationLost(fence=fence):
                return structs.replace(notice, fence=self._fences[number][fence])
            case _:
                return notice

    def _serial_at(self, number: int, task: str, serial: int) -> int:
        """The rank of the number of a message about the task at the Repository with this number."""
        ranks = self._serials[TASKS.index(task)]
        return ranks[serial] if TASKS[number] == task else 2 * ranks[serial // 2] + serial % 2

    def _body(self, body: Any, number: int) -> Any:
        return structs.replace(body, fence=self._fences[number][body.fence]) if isinstance(body, Reserved) else body

    def _message(self, message: Token, number: int) -> Token:
        match message:
            case Reserve(task=task, serial=serial) | Release(task=task, serial=serial):
                return structs.replace(message, serial=self._serial_at(1 - number, task, serial))
            case Reply(task=task, serial=serial, body=body):
                return Reply(task, self._serial_at(number, task, serial), self._body(body, number))
            case ReservationLost(fence=fence):
                return structs.replace(message, fence=self._fences[number][fence])
            case PassedReport(reservation=UnderReservation(fence=fence) as reservation):
                return structs.replace(message, reservation=structs.replace(reservation, fence=self._fences[1 - number][fence]))
            case _:
                return message


def _ranked(numbers: Iterable[int]) -> dict[int, int]:
    return {number: rank for rank, number in enumerate(sorted(numbers))}
