"""Draws a run from a seed: the message, the victim, the scenario, the moment of the kill, and the time until the restart."""

from __future__ import annotations

import random
from dataclasses import dataclass
from enum import StrEnum

from somrs.protocol.frp.states import TO_COORDINATOR, TO_PARTICIPANT
from somrs.protocol.messages.submission import Policy
from verification.kill_runs.scenarios import CHEAP, DEAR, PLACES, THINGS, Scenario, scenarios_of

MESSAGES = tuple(dict.fromkeys(kind.__name__ for kind in (*TO_PARTICIPANT, *TO_COORDINATOR)))
"""Every type of message of the Failure Recovery Protocol."""

MOST_DELAY = 0.02
"""The maximum delay from the message to the kill, in seconds: the message may be in transit, handled, stored or answered by then."""
MOST_PAUSE = 3.0
"""The maximum time until the restart, in seconds."""
MAX_ATTEMPTS = 8
"""The number of attempts if the kill comes too late; the second half of them kill without a delay."""
IMPOSSIBLE = "Jar003"
"""A thing that nothing can be put on."""


class Victim(StrEnum):
    """The target of the kill or fault."""

    TASK_MANAGER = "task-manager"
    DEVICE = "device"
    """The process of the Service Manager of a device that takes part in the task."""
    REGISTRY = "registry"
    REPOSITORY = "repository"
    LINK = "link"
    """The connection between a device's Service Manager and the simulator: cut, and refused until it is repaired."""
    HOST = "host"
    """On a bus, the host that leads the Task Manager: its components and its server of the bus are killed for good, and standbys take
    over."""


CELLS = tuple((message, victim) for message in MESSAGES for victim in Victim if victim is not Victim.HOST)
"""Every pair of message and victim. A seed determines a pair, and consecutive seeds cover all of them."""
CELLS_ON_BUS = tuple((message, Victim.HOST) for message in MESSAGES)
"""The same for a system on a bus."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A run. The victim is killed `delay` seconds after message number `nth` of the type, and is down for `pause` seconds."""

    seed: int
    attempt: int
    message: str
    victim: Victim
    scenario: Scenario
    placements: tuple[tuple[str, str], ...]
    """Things and the places where the goal wants them."""
    policy: Policy
    nth: int
    delay: float
    pause: float
    device_choice: float
    """Selects the device, from 0 to 1: up to a half, the sender or recipient of the message."""

    @property
    def goal(self) -> str:
        return " AND ".join(f"{thing} isOn {place}" for thing, place in self.placements)

    def __str__(self) -> str:
        moment = f"{self.message} {self.nth}" + (f" + {self.delay * 1000:.0f} ms" if self.delay else "")
        return f"{self.scenario.name} ({self.goal}): the {self.victim} is struck at {moment}, for {self.pause:.1f} s"


def draw_case(seed: int, attempt: int = 0, *, is_on_bus: bool = False) -> Case:
    """Return the run of a seed. A later attempt is another draw for the same message and victim."""
    cells = CELLS_ON_BUS if is_on_bus else CELLS
    chance = random.Random(f"{seed}/{attempt}")
    message, victim = cells[seed % len(cells)]
    scenario = chance.choice(scenarios_of(message))
    things = chance.sample(THINGS, chance.randint(1, scenario.most_things))
    placements = tuple((thing, chance.choice([place for place in PLACES if place != HOMES[thing]])) for thing in things)
    if not scenario.possible:
        placements = (("Carton001", IMPOSSIBLE),)
    broken = {robot for robot, _ in scenario.broken} | {breakdown.robot for breakdown in scenario.breaks}
    max_count = 1 if attempt == MAX_ATTEMPTS - 1 else scenario.count(message, len(placements))
    return Case(
        seed=seed,
        attempt=attempt,
        message=message,
        victim=victim,
        scenario=scenario,
        placements=placements,
        policy=Policy.PRICE if CHEAP in broken and DEAR not in broken else chance.choice((Policy.PRICE, Policy.TIME)),
        nth=chance.randint(1, max_count),
        delay=chance.choice((0.0, 0.0, chance.uniform(0.0, MOST_DELAY))) if attempt < MAX_ATTEMPTS // 2 else 0.0,
        pause=chance.uniform(0.0, MOST_PAUSE),
        device_choice=chance.random(),
    )


HOMES = {"Jar002": "Cupboard001", "Jar003": "Cupboard001", "Carton001": "Table002"}
"""The places of things at the start of a run."""
