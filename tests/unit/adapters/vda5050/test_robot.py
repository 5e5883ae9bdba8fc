"""The device of a vehicle: what it is told becomes messages, and what the vehicle says becomes results."""

from __future__ import annotations

import asyncio
import json
import math
from pathlib import Path
from typing import Any

import pytest

from somrs.adapters.vda5050.frames import Frames
from somrs.adapters.vda5050.messages.encoding import encode
from somrs.adapters.vda5050.messages.header import Topic, Version
from somrs.adapters.vda5050.robot import Vda5050Vehicle
from somrs.adapters.vda5050.session import VehicleSession
from somrs.adapters.vda5050.settings import read_settings
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from somrs.adapters.vda5050.topics import VehicleAddress
from somrs.devices.road_robot import RobotFailed
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.traffic import RoadmapPlace
from somrs.service_manager.sdk.device import Task
from somrs.service_manager.sdk.orders import Order, Refusal
from somrs.traffic.robot_tasks import RoadmapRead
from tests.support.lab import lab
from tests.support.road_lab import RoadLab, in_virtual_time
from tests.support.vda5050_messages import HEADER
from tests.unit.adapters.vda5050.test_messages import MINIMAL
from tests.unit.adapters.vda5050.test_stations import sheet_with

ADDRESS = VehicleAddress(interface="uagv", major=2, manufacturer="ACME", serial_number="0001")

STATE = MINIMAL | {"headerId": 0, "timestamp": "", "loads": []}


class Bench:
    """A device whose vehicle is this test. `sent`: what it was sent, as documents, by topic."""

    def __init__(self, **settings: Any) -> None:
        self.sent: list[tuple[str, dict[str, Any]]] = []
        self.session = VehicleSession(ADDRESS, Frames(), lambda topic, payload: self.sent.append((topic, json.loads(payload))))
        self.session.receive(Topic.FACTSHEET, encode(factsheet(), HEADER, Version.V2_1))
        self.say()
        actions = frozenset({"pick", "drop", "startCharging"})
        self.device = Vda5050Vehicle("Robot1", self.session, read_settings({"broker": "mqtt://broker", **settings}), actions)
        self.session.on_effect = self.device._take_effect

    def say(self, **changes: Any) -> None:
        self.session.receive(Topic.STATE, json.dumps(STATE | changes).encode())

    def newest(self, topic: str) -> dict[str, Any]:
        return next(document for name, document in reversed(self.sent) if name == f"uagv/v2/ACME/0001/{topic}")

    def answer(self, status: str, **changes: Any) -> None:
        """The state of the vehicle with the action of its order."""
        order = self.newest("order")
        action = {"actionId": order["nodes"][0]["actions"][0]["actionId"], "actionType": "pick", "actionStatus": status}
        self.say(orderId=order["orderId"], actionStates=[action], **changes)


def test_a_pick_names_the_load_and_the_station() -> None:
    async def test() -> None:
        bench = Bench(stationType="rack", loadType="EPAL")
        picking = asyncio.create_task(bench.device.pick("Jar7", "Shelf1"))
        await asyncio.sleep(0)
        parameters = bench.newest("order")["nodes"][0]["actions"][0]["actionParameters"]
        values = {parameter["key"]: parameter["value"] for parameter in parameters}
        assert values == {"stationType": "rack", "loadType": "EPAL", "stationName": "Shelf1", "loadId": "Jar7"}
        bench.answer("RUNNING")
        assert not picking.done()
        bench.answer("FINISHED", loads=[{"loadId": "Jar7"}])
        await picking
        assert bench.device.carries

    asyncio.run(test())


def test_stations_and_heights_are_those_of_the_map() -> None:
    async def test() -> None:
        bench = Bench(stationTypes={"Table2": "rack"})
        vehicle = bench.session.control.vehicle
        vehicle.factsheet = sheet_with("stationType", "height", maximum_loadhandling_height=0.6)
        ontology, map = lab()

        async def whole_map(*, is_current: bool = True) -> tuple[Map, Ontology]:
            return map, ontology

        bench.device.whole_map = whole_map
        bench.device.building.update(map, ontology, RoadmapRead(1, (RoadmapPlace(name="P1", x=3.0, y=3.0),)))
        with pytest.raises(RobotFailed, match=r"handles loads at 0 to 0.6 m over the floor, and not at 0.70 m"):
            await bench.device.pick("Jar1", "Table1")
        vehicle.factsheet = sheet_with("stationType", "height")
        for support, station_type in {"Table1": "Table", "Table2": "rack"}.items():
            work = asyncio.create_task(bench.device.drop("Jar1", support))
            await asyncio.sleep(0)
            parameters = bench.newest("order")["nodes"][0]["actions"][0]["actionParameters"]
            assert {parameter["key"]: parameter["value"] for parameter in parameters} == {"stationType": station_type, "height": 0.7}
            bench.answer("FINISHED")
            await work

    asyncio.run(test())


@pytest.mark.parametrize(("highest", "reason"), [(0.6, "handles loads at 0 to 0.6 m over the floor, and not at 0.70 m"), (0.8, None)])
def test_a_task_beyond_what_the_vehicle_handles_is_refused_when_it_is_quoted(tmp_path: Path, highest: float, reason: str | None) -> None:
    async def test() -> None:
        bench, lab = Bench(), RoadLab(tmp_path)
        await lab.start()
        bench.session.control.vehicle.factsheet = sheet_with("height", maximum_loadhandling_height=highest)
        bench.device.whole_map, bench.device.battery = lab.whole_map, None
        bench.device._link, bench.device.road._map.roadmap = bench.device._make_link(), lab.read_roadmap()
        bench.device.located(lab.robots["Robot1"].body.x, lab.robots["Robot1"].body.y, 0.0, 0.0)
        order = Order(
            participant="Robot1",
            method="transfer",
            inputs={"Object": "Jar1", "Destination": "Platform1"},
            effect="Jar1 isOn Platform1",
            precondition="Jar1 isOn Table1",
        )
        task = Task("Robot1", order, lab.answer, print, quoting=True)
        if reason is not None:
            with pytest.raises(Refusal, match=reason):
                await bench.device.legs(task)
        else:
            assert max(await bench.device.legs(task)) > 1.0

    in_virtual_time(test())


def test_a_pick_that_fails_says_why_and_what_the_vehicle_holds() -> None:
    async def test() -> None:
        bench = Bench()
        picking = asyncio.create_task(bench.device.pick("Jar7", "Shelf1"))
        await asyncio.sleep(0)
        bench.answer("RUNNING", loads=[{}])
        assert bench.device.carries
        bench.answer("FAILED", loads=[], errors=[{"errorType": "slipped", "errorLevel": "WARNING", "errorReferences": []}])
        with pytest.raises(RobotFailed, match="Robot1 gave up: the vehicle does not say why"):
            await picking
        assert bench.device.carries is False

    asyncio.run(test())


def test_a_load_that_is_put_down_is_where_the_vehicle_carried_it() -> None:
    """Seen before a platform: the jar was on it, and the map had it on the floor, at the middle of the vehicle."""

    async def test() -> None:
        bench = Bench()
        position = {"x": 2.0, "y": 1.0, "theta": math.pi / 2, "mapId": "map", "localized": True}
        load = {"loadId": "Jar7", "boundingBoxReference": {"x": 0.5, "y": 0.1, "z": 0.0}}
        bench.say(mobileRobotPosition=position, loads=[load])
        putting = asyncio.create_task(bench.device.put_down("Jar7"))
        await asyncio.sleep(0)
        bench.answer("FINISHED", mobileRobotPosition=position)
        x, y, *rest = await putting
        assert [x, y] == pytest.approx([1.9, 1.5])
        assert rest == [0.0, ""]
        ontology, map = lab()
        bench.device.building.update(map, ontology, RoadmapRead(1, (RoadmapPlace(name="P1", x=3.0, y=3.0),)))
        table = map.objects["Table1"].values
        bench.say(mobileRobotPosition=position | {"x": table["PositionX"], "y": table["PositionY"]}, loads=[load])
        with pytest.raises(RobotFailed, match="Robot1 carries Jar7 before Table1"):
            await bench.device.put_down("Jar7")

    asyncio.run(test())


def test_what_nobody_wants_any_more_is_cancelled_when_the_vehicle_is_there_again() -> None:
    async def test() -> None:
        bench = Bench()
        picking = asyncio.create_task(bench.device.pick("Jar7", "Shelf1"))
        await asyncio.sleep(0)
        bench.answer("RUNNING")
        bench.session.notice_broker(is_connected=False)
        picking.cancel()
        await asyncio.wait({picking})
        bench.answer("RUNNING")
        assert bench.newest("instantActions")["actions"][0]["actionType"] == "cancelOrder"

    asyncio.run(test())


def test_halting_takes_until_the_vehicle_stands() -> None:
    async def test() -> None:
        bench = Bench()
        picking = asyncio.create_task(bench.device.pick("Jar7", "Shelf1"))
        await asyncio.sleep(0)
        bench.answer("RUNNING")
        halting = asyncio.create_task(bench.device.interrupt())
        await asyncio.sleep(0)
        cancel = bench.newest("instantActions")["actions"][0]
        done = {"actionId": cancel["actionId"], "actionType": "cancelOrder", "actionStatus": "FINISHED"}
        bench.say(orderId=bench.newest("order")["orderId"], actionStates=[done], driving=True)
        await asyncio.sleep(0)
        assert not halting.done()
        bench.say(orderId=bench.newest("order")["orderId"], actionStates=[done])
        await halting
        picking.cancel()
        await asyncio.wait({picking})

    asyncio.run(test())


def test_the_attributes_of_a_vehicle_come_from_its_factsheet() -> None:
    values = Bench().device.values
    assert values == {"Shape.Form": "Cylinder", "Shape.Radius": 0.5, "Shape.Height": 0.6, "Speed": 1.0, "Payload": 20.0}


def test_a_vehicle_that_is_there_again_can_be_reached_when_it_has_said_how_it_is() -> None:
    """What is retained at the broker says that it is online; what it did meanwhile, only its state does."""

    async def test() -> None:
        bench = Bench()
        bench.session.notice_broker(is_connected=False)
        header = {key: STATE[key] for key in ("headerId", "timestamp", "version", "manufacturer", "serialNumber")}
        bench.session.receive(Topic.CONNECTION, json.dumps({**header, "connectionState": "ONLINE"}).encode())
        assert not bench.session.control.vehicle.is_connected
        assert bench.newest("instantActions")["actions"][0]["actionType"] == "stateRequest"
        bench.say()
        assert bench.session.control.vehicle.is_connected

    asyncio.run(test())
