"""What is put on the map through the API fits there."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.client.refusals import Refused
from somrs.ontology.objects import Change, ValueSet
from somrs.ontology.values import value_of
from somrs.protocol.messages.knowledge import UpdateMap
from tests.support.hang import HANG_TIME
from tests.support.small_system import Porter, running


def test_furniture_is_not_put_on_a_robot_nor_a_robot_on_furniture(tmp_path: Path) -> None:
    async def run() -> None:
        async with asyncio.timeout(HANG_TIME), running(tmp_path, Porter("Robot1")) as (_, api):
            map, ontology = api.context.map, api.context.ontology

            def put(name: str, place: str) -> UpdateMap:
                changes: list[Change] = [ValueSet(name, path, value_of(place, path, map, ontology)) for path in ("PositionX", "PositionY")]
                return UpdateMap(changes=tuple(changes))

            for name, place in (("Cupboard002", "Robot1"), ("Robot1", "Cupboard002")):
                with pytest.raises(Refused, match="does not fit there") as refusal:
                    await api.map.change(put(name, place))
                assert [(rule.subject, rule.rule) for rule in refusal.value.broken] == [(name, "no-room")]
            await api.map.change(put("Cupboard002", "Cupboard002"))
            with pytest.raises(Refused, match="Cupboard009"):
                await api.map.change(UpdateMap(changes=(ValueSet("Cupboard009", "PositionX", 1.0),)))

    asyncio.run(run())
