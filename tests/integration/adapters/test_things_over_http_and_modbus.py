"""Things that are read again and again: over HTTP and Modbus TCP, and such as are described by a W3C Thing Description."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import time
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from aiohttp import web
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from somrs.ports import listen_at
from somrs.protocol.messages.frp import Outcome
from tests.support.accomplishing import accomplish
from tests.support.hang import HANG_TIME
from tests.support.things_lab import things_lab

LAMP = """
connections: {{lamp: {{url: "{url}"}}}}
things:
  Lamp1:
    type: Light
    at: [1, 1, 2]
    attributes:
      On: {{path: /state, json: "on", poll: 200 ms}}
      Brightness: {{path: /state, json: level, scale: 0.392157, poll: 200 ms}}
    services:
      SwitchOn: {{write: [{{put: /state, payload: '{{"on": true}}'}}]}}
      SetBrightness:
        write: [{{put: /state, payload: '{{"level": ?Brightness}}', convert: {{Brightness: {{scale: 0.392157, decimals: 0}}}}}}]
"""

BOILER = """
connections: {{boiler: {{url: "modbus://127.0.0.1:{port}/1"}}}}
things:
  Boiler1:
    type: Heater
    at: [2, 2, 0]
    attributes:
      Temperature: {{register: holding 0, as: int16, scale: 0.1, poll: 200 ms}}
      TargetTemperature: {{register: holding 1, as: float32, poll: 200 ms}}
    services:
      SetTemperature:
        write: [{{register: holding 1, as: float32, payload: '?Temperature', convert: {{Temperature: {{range: [5, 90]}}}}}}]
"""

DESCRIPTION = {
    "@context": "https://www.w3.org/2022/wot/td/v1.1",
    "title": "Desk lamp",
    "securityDefinitions": {"nosec_sc": {"scheme": "nosec"}},
    "security": ["nosec_sc"],
    "properties": {
        "on": {"type": "boolean", "forms": [{"href": "/properties/on"}]},
        "tint": {"type": "integer", "minimum": 1, "maximum": 9, "forms": [{"href": "/properties/tint"}]},
    },
    "actions": {"fade": {"forms": [{"href": "/actions/fade"}]}},
}


class Lamp:
    """A lamp with a server. `refuses`: it answers with an error."""

    def __init__(self) -> None:
        self.state: dict[str, object] = {"on": False, "level": 0}
        self.properties: dict[str, object] = {"on": False, "tint": 3}
        self.refuses = False
        self.refused_at: list[float] = []
        self.url = ""

    async def read(self, request: web.Request) -> web.Response:
        return web.json_response(self.state)

    async def write(self, request: web.Request) -> web.Response:
        if self.refuses:
            self.refused_at.append(time.monotonic())
            return web.Response(status=409, text="the bulb is missing")
        self.state |= await request.json()
        return web.Response(status=204)

    async def describe(self, request: web.Request) -> web.Response:
        return web.json_response(DESCRIPTION)

    async def read_property(self, request: web.Request) -> web.Response:
        return web.json_response(self.properties[request.match_info["name"]])

    async def write_property(self, request: web.Request) -> web.Response:
        self.properties[request.match_info["name"]] = json.loads(await request.text())
        return web.Response(status=204)

    @contextlib.asynccontextmanager
    async def serving(self, port: int = 0) -> AsyncIterator[None]:
        application = web.Application()
        application.add_routes(
            [
                web.get("/state", self.read),
                web.put("/state", self.write),
                web.get("/td.json", self.describe),
                web.get("/properties/{name}", self.read_property),
                web.put("/properties/{name}", self.write_property),
            ]
        )
        runner = web.AppRunner(application)
        await runner.setup()
        with listen_at("127.0.0.1", port) as socket:
            await web.SockSite(runner, socket).start()
            self.url = f"http://127.0.0.1:{socket.getsockname()[1]}"
            try:
                yield
            finally:
                await runner.cleanup()


def test_a_lamp_with_a_server_is_switched_and_dimmed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("somrs.adapters.things.thing_device.FIRST_PAUSE", 0.1)

    async def test() -> None:
        lamp = Lamp()
        async with lamp.serving():
            (tmp_path / "lamp.yaml").write_text(LAMP.format(url=lamp.url))
            async with things_lab(tmp_path, {"mappings": ["lamp.yaml"]}) as lab:
                await lab.until("Lamp1.On = FALSE AND Lamp1.Working = TRUE")
                assert (await accomplish(lab.client, "Lamp1.On = TRUE")).outcome is Outcome.ACCOMPLISHED
                assert lamp.state["on"] is True
                assert (await accomplish(lab.client, "Lamp1.Brightness = 40")).outcome is Outcome.ACCOMPLISHED
                assert lamp.state["level"] == 102
                lamp.state["on"] = False  # by its own switch
                await lab.until("Lamp1.On = FALSE")
                lamp.refuses = True
                view = await accomplish(lab.client, "Lamp1.On = TRUE", waits=False)
                assert view.outcome is Outcome.FAILED
                assert "the bulb is missing" in str(view)
                assert "SwitchOn by Lamp1.SwitchOn changed nothing: Lamp1.On = FALSE" in view.explanation
                assert all(second - first > 0.05 for first, second in itertools.pairwise(lamp.refused_at)), "it is not hammered"

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))


def test_a_server_that_is_gone_does_not_work_and_works_again_when_it_is_back(tmp_path: Path) -> None:
    async def test() -> None:
        lamp = Lamp()
        with listen_at("127.0.0.1", 0) as free:
            port = free.getsockname()[1]
        (tmp_path / "lamp.yaml").write_text(LAMP.format(url=f"http://127.0.0.1:{port}"))
        async with things_lab(tmp_path, {"mappings": ["lamp.yaml"]}) as lab:
            await lab.until("Lamp1.Working = FALSE")
            async with lamp.serving(port):
                await lab.until("Lamp1.Working = TRUE AND Lamp1.On = FALSE")
            await lab.until("Lamp1.Working = FALSE")

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))


def test_a_thing_description_becomes_a_device_without_a_mapping(tmp_path: Path) -> None:
    async def test() -> None:
        lamp = Lamp()
        async with lamp.serving(), things_lab(tmp_path, {"descriptions": [f"{lamp.url}/td.json"]}) as lab:
            await lab.until("DeskLamp.On = FALSE AND DeskLamp.Tint = 3")
            assert (await accomplish(lab.client, "DeskLamp.On = TRUE AND DeskLamp.Tint = 7")).outcome is Outcome.ACCOMPLISHED
            assert lamp.properties == {"on": True, "tint": 7}

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))


def test_a_boiler_with_modbus_heats_to_a_temperature(tmp_path: Path) -> None:
    async def test() -> None:
        with listen_at("127.0.0.1", 0) as free:
            port = free.getsockname()[1]
        registers = SimDevice(id=1, simdata=[SimData(address=0, values=[185, 0, 0, 0], datatype=DataType.REGISTERS)])
        server = ModbusTcpServer(registers, address=("127.0.0.1", port))
        await server.serve_forever(background=True)
        (tmp_path / "boiler.yaml").write_text(BOILER.format(port=port))
        try:
            async with things_lab(tmp_path, {"mappings": ["boiler.yaml"]}) as lab:
                await lab.until("Boiler1.Temperature = 18.5 AND Boiler1.TargetTemperature = 0 AND Boiler1.Working = TRUE")
                assert (await accomplish(lab.client, "Boiler1.TargetTemperature = 60.5")).outcome is Outcome.ACCOMPLISHED
                view = await accomplish(lab.client, "Boiler1.TargetTemperature = 200")
                assert view.outcome is Outcome.FAILED, "it does not wait for what can never be"
                assert "200 degC is beyond range: 5 to 90 degC" in str(view)
                client = AsyncModbusTcpClient("127.0.0.1", port=port)
                await client.connect()
                answer = await client.read_holding_registers(1, count=2)
                client.close()
                assert client.convert_from_registers(answer.registers, client.DATATYPE.FLOAT32) == 60.5
        finally:
            await server.shutdown()  # type: ignore[no-untyped-call]

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))
