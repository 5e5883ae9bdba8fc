"""What a site wants of its vehicles."""

from __future__ import annotations

from msgspec import Struct

from somrs.adapters.vda5050.control.provision import MapPackage


class Policy(Struct, frozen=True, kw_only=True):
    """`packages`: the maps that each is to have. `retries`: how often an action is tried again that has failed, if the vehicle can do that
    (3.0, 6.6.9). `hibernate_after`: seconds without anything to do, after which a vehicle hibernates; None: never."""

    packages: tuple[MapPackage, ...] = ()
    retries: int = 1
    hibernate_after: float | None = None
