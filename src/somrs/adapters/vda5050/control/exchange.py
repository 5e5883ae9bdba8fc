"""What the state machine of a vehicle takes in, and what it has done about it. Times are in seconds since 1970."""

from __future__ import annotations

from msgspec import Struct

from somrs.adapters.vda5050.frames import Pose
from somrs.adapters.vda5050.messages.decoding import Received
from somrs.adapters.vda5050.messages.header import Topic
from somrs.adapters.vda5050.messages.orders import ActionParameter, InstantActions, Order, Responses, ZoneSet
from somrs.adapters.vda5050.zoning.site import SiteZone
from somrs.devices.road_robot import Way


class Arrived(Struct, frozen=True, kw_only=True):
    """A message of the vehicle has arrived."""

    topic: Topic
    received: Received


class Subscribed(Struct, frozen=True):
    """The broker is there, and messages of the vehicle will arrive."""


class Disconnected(Struct, frozen=True):
    """The broker is gone."""


class Follow(Struct, frozen=True, kw_only=True):
    """Drive along a way. It takes the place of the way before."""

    way: Way


class Halt(Struct, frozen=True):
    """Stand still, and forget the way and the action. Answered by Halted."""


class Pause(Struct, frozen=True):
    """Stand still, with all that the vehicle does, until Resume."""


class Resume(Struct, frozen=True):
    """Go on."""


class Perform(Struct, frozen=True, kw_only=True):
    """Perform an action where the vehicle stands. Answered by ActionEnded."""

    action_type: str
    parameters: tuple[ActionParameter, ...] = ()


class Charge(Struct, frozen=True):
    """Charge until the battery is full. Answered by ActionEnded."""


class BuildingChanged(Struct, frozen=True, kw_only=True):
    """The zones of the site are these."""

    zones: tuple[SiteZone, ...]


class Tick(Struct, frozen=True):
    """Time has passed."""


Input = Arrived | Subscribed | Disconnected | Follow | Halt | Pause | Resume | Perform | Charge | BuildingChanged | Tick


class Send(Struct, frozen=True, kw_only=True):
    """Send a message to the vehicle."""

    topic: Topic
    message: Order | InstantActions | Responses | ZoneSet


class Located(Struct, frozen=True, kw_only=True):
    """The vehicle is at this pose on the map of the site."""

    pose: Pose


class Passed(Struct, frozen=True, kw_only=True):
    """The vehicle has passed the waypoint of this number."""

    number: int


class GaveUp(Struct, frozen=True, kw_only=True):
    """The vehicle does not drive along its way, and stands."""

    description: str


class Broken(Struct, frozen=True, kw_only=True):
    """Why the vehicle cannot drive; None: it can."""

    reason: str | None


class Reachable(Struct, frozen=True, kw_only=True):
    """Whether the vehicle can be reached."""

    is_connected: bool


class Halted(Struct, frozen=True):
    """The vehicle stands, and has no order."""


class ActionEnded(Struct, frozen=True, kw_only=True):
    """The action has ended. `failure`: why it failed; None: it did not."""

    failure: str | None


class Warned(Struct, frozen=True, kw_only=True):
    """The vehicle says something that does not stop it, for the first time. `is_urgent`: it needs attention."""

    description: str
    is_urgent: bool = False


class Remarked(Struct, frozen=True, kw_only=True):
    """What the vehicle says now that does not stop it; None: nothing."""

    text: str | None


class Delayed(Struct, frozen=True, kw_only=True):
    """What keeps the vehicle from going on, and will pass without fleet control; None: nothing does any more."""

    reason: str | None


class Tolerated(Struct, frozen=True, kw_only=True):
    """The vehicle did something that its version does not have, for the first time."""

    deviation: str


class Refused(Struct, frozen=True, kw_only=True):
    """The vehicle asks for what it does not get, does not take what it is to have, or says nothing. Told once."""

    description: str


class Charged(Struct, frozen=True, kw_only=True):
    """The charge, in percent of that to which the battery is charged."""

    level: float


class Loaded(Struct, frozen=True, kw_only=True):
    """What the vehicle carries has changed. `count`: how many loads; it may not know which."""

    count: int


Effect = (
    Send
    | Located
    | Passed
    | GaveUp
    | Broken
    | Reachable
    | Halted
    | ActionEnded
    | Warned
    | Remarked
    | Delayed
    | Tolerated
    | Refused
    | Charged
    | Loaded
)
