"""The neighbours in the state of a Registry: which they are, and whether they may subscribe."""

from __future__ import annotations

from collections.abc import Iterable

from somrs.errors import UsageError
from somrs.kernel.component import Effect, SetTimer
from somrs.registry.neighbours import Neighbour, NeighbourDue, NeighbourReplica, NeighbourState, check_neighbours
from somrs.registry.state import RegistryState


def configure(state: RegistryState, neighbours: Iterable[Neighbour]) -> list[Effect]:
    """Have these neighbours from the next start on. What is known of those that stay is kept. Raises UsageError."""
    neighbours = [*neighbours]
    check_neighbours(neighbours, state.address)
    old_neighbours, old_audiences = state.neighbours, {address: state.audience(address) for address in state.subscribers}
    state.neighbours = {settings.name: _configured(state.address, settings, old_neighbours.get(settings.name)) for settings in neighbours}
    for address, audience in old_audiences.items():
        if state.audience(address) != audience:
            del state.subscribers[address]  # it sees something else now, and subscribes again
    followed = {name for name, neighbour in state.neighbours.items() if neighbour.copy is not None}
    return [SetTimer(NeighbourDue(name), None) for name in old_neighbours if name not in followed]


def _configured(owner: str, settings: Neighbour, neighbour: NeighbourState | None) -> NeighbourState:
    if neighbour is None or neighbour.settings.address != settings.address:
        neighbour = NeighbourState(settings=settings)
    neighbour.settings = settings
    if settings.takes is None:
        neighbour.copy = None
    elif neighbour.copy is None:
        neighbour.copy = NeighbourReplica(owner, settings.address, name=settings.name)
    return neighbour


def check_given(state: RegistryState, address: str) -> None:
    """Raises UsageError if a Registry at this address is given nothing."""
    audience = state.audience(address)
    if not audience:
        raise UsageError(
            f"{address} is no neighbour of the Registry at {state.address}: its owner has to add this address to its neighbours"
        )
    if state.neighbours[audience].settings.gives is None:
        raise UsageError(
            f"the Registry at {state.address} gives nothing to {audience}, its neighbour at {address}: its owner has to change `gives`"
        )
