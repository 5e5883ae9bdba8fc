"""Devices and their services; faults of simulated robots."""

from __future__ import annotations

import msgspec

from somrs.app.desk.context import Context
from somrs.app.desk.operations import operation
from somrs.protocol.directory import Discover, Offer


class Services(msgspec.Struct, frozen=True, kw_only=True):
    offers: tuple[Offer, ...]


class FleetDesk:
    def __init__(self, context: Context) -> None:
        self._context = context

    @operation("GET", "/services")
    async def services(self, type: str | None = None, effect: str | None = None) -> Services:
        """What is on offer now: all, or services of a type, or those that can bring about an effect."""
        return Services(offers=await self._context.client.services(Discover(service_type=type, effect=effect)))
