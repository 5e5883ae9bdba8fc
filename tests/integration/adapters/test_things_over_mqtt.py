"""Things over MQTT: what they say comes onto the map, they have services, and fail and come back as they announce it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import time
from collections.abc import AsyncIterator
from pathlib import Path

import aiomqtt

from somrs.protocol.messages.findings import Sighting
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from tests.support.accomplishing import accomplish, finished
from tests.support.hang import HANG_TIME
from tests.support.mqtt_broker import MqttBroker
from tests.support.small_system import Porter
from tests.support.things_lab import ThingsLab, things_lab
from tests.support.virtual_system import SITE

MAPPING = """
connections:
  house: {{url: "{url}"}}
attributes:
  Fault: {{kind: truth}}
  Stable: {{kind: truth}}
types:
  LabScale: {{parent: Scale, attributes: [MeasuredWeight, Stable]}}
  FancyHeater: {{parent: Heater, attributes: [Fault]}}
things:
  Heater1:
    type: FancyHeater
    at: [1, 2, 0.5]
    available: {{topic: heaters/1/status}}
    attributes:
      Temperature: {{topic: heaters/1/state, json: temperature, dead_band: 0.5}}
      TargetTemperature: {{topic: heaters/1/state, json: target}}
      HeatingMode: {{topic: heaters/1/state, json: mode, values: {{heat: Heating, "off": Off}}}}
      Fault: {{topic: heaters/1/fault}}
    services:
      SetTemperature:
        write: [{{topic: heaters/1/set, payload: '{{"target": ?Temperature}}'}}]
        failed_when: "?Provider.Fault = TRUE"
  Scale1:
    type: LabScale
    at: [1, 3, 0]
    attributes:
      MeasuredWeight: {{topic: scales/1, json: weight, unit: g}}
      Stable: {{topic: scales/1, json: stable}}
    services:
      WeighObject:
        write: [{{topic: scales/1/get, payload: now}}]
        demand: "?Object isOn ?Provider"
        done_when: "?Provider.Stable = TRUE"
        outputs: {{Weight: MeasuredWeight}}
  Sensor1:
    type: Sensor
    at: [3, 3, 2]
    attributes:
      Temperature: {{topic: sensors/1, unit: degF}}
"""


class Heater:
    """A heater that speaks MQTT. `is_stuck`: it says that it has a fault instead of heating."""

    def __init__(self, client: aiomqtt.Client) -> None:
        self._client = client
        self.state = {"temperature": 18.0, "target": 16.0, "mode": "off"}
        self.is_stuck = False

    async def run(self) -> None:
        await self._client.publish("heaters/1/status", "online", qos=1, retain=True)
        await self.say()
        await self._client.subscribe("heaters/1/set", qos=1)
        async for message in self._client.messages:
            assert isinstance(message.payload, bytes)
            if self.is_stuck:
                await self._client.publish("heaters/1/fault", "true", qos=1)
            else:
                self.state |= {"target": json.loads(message.payload)["target"], "mode": "heat"}
                await self.say()

    async def say(self) -> None:
        await self._client.publish("heaters/1/state", json.dumps(self.state), qos=1, retain=True)


def mqtt_client(broker: MqttBroker, will: aiomqtt.Will | None = None) -> aiomqtt.Client:
    return aiomqtt.Client("127.0.0.1", broker.mqtt_port, will=will)


@contextlib.asynccontextmanager
async def heater(broker: MqttBroker) -> AsyncIterator[Heater]:
    """A heater with a last will. At the end of the context its connection breaks off."""
    will = aiomqtt.Will("heaters/1/status", "offline", qos=1, retain=True)
    with contextlib.suppress(aiomqtt.MqttError):
        async with mqtt_client(broker, will) as client:
            device = Heater(client)
            running = asyncio.create_task(device.run())
            try:
                yield device
            finally:
                running.cancel()
                await asyncio.gather(running, return_exceptions=True)
                connection = client._client.socket()
                assert isinstance(connection, socket.socket)
                connection.shutdown(socket.SHUT_RDWR)  # without a farewell, so that the broker publishes the will
                await asyncio.wait([client._disconnected])


def settings(tmp_path: Path, broker: MqttBroker) -> dict[str, object]:
    (tmp_path / "things.yaml").write_text(MAPPING.format(url=broker.url))
    return {"mappings": ["things.yaml"]}


def test_a_heater_heats_to_a_temperature_and_the_map_has_what_it_says(tmp_path: Path) -> None:
    async def test() -> None:
        with MqttBroker(tmp_path) as broker:
            async with things_lab(tmp_path, settings(tmp_path, broker)) as lab, heater(broker) as device:
                await lab.until("Heater1.Temperature = 18 AND Heater1.HeatingMode = Off AND Heater1.Working = TRUE")
                view = await accomplish(lab.client, "Heater1.TargetTemperature = 21.5")
                assert view.outcome is Outcome.ACCOMPLISHED
                assert device.state["target"] == 21.5
                await lab.until("Heater1.TargetTemperature = 21.5 AND Heater1.HeatingMode = Heating AND Heater1.PositionX = 1")

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))


def test_a_thing_that_says_that_it_failed_fails_the_task(tmp_path: Path) -> None:
    async def test() -> None:
        with MqttBroker(tmp_path) as broker:
            async with things_lab(tmp_path, settings(tmp_path, broker)) as lab, heater(broker) as device:
                await lab.until("Heater1.Working = TRUE")
                device.is_stuck = True
                view = await accomplish(lab.client, "Heater1.TargetTemperature = 21.5", waits=False)
                assert view.outcome is Outcome.FAILED
                await lab.until("Heater1.Fault = TRUE AND Heater1.TargetTemperature = 16")

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))


def test_a_thing_whose_connection_breaks_does_not_work_until_it_is_back(tmp_path: Path) -> None:
    async def test() -> None:
        with MqttBroker(tmp_path) as broker:
            async with things_lab(tmp_path, settings(tmp_path, broker)) as lab:
                async with heater(broker):
                    await lab.until("Heater1.Working = TRUE")
                await lab.until("Heater1.Working = FALSE")
                view = await accomplish(lab.client, "Heater1.TargetTemperature = 20", waits=False)
                assert view.outcome is Outcome.FAILED
                async with heater(broker):
                    await lab.until("Heater1.Working = TRUE")
                    assert (await accomplish(lab.client, "Heater1.TargetTemperature = 20")).outcome is Outcome.ACCOMPLISHED

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))


def test_a_sensor_is_put_on_the_map_with_its_values_and_a_lost_broker_is_found_again(tmp_path: Path) -> None:
    async def test() -> None:
        with MqttBroker(tmp_path) as broker:
            async with things_lab(tmp_path, settings(tmp_path, broker)) as lab:
                async with mqtt_client(broker) as client:
                    await client.publish("sensors/1", "68", qos=1, retain=True)
                    await lab.until("Sensor1.Temperature = 20 AND Sensor1.PositionZ = 2")
                heard_by = time.time()
                observation = await sighting(lab)
                assert observation is not None
                assert observation.at <= heard_by
                broker.kill()
                while (observation := await sighting(lab)) is not None:
                    assert observation.at <= heard_by
                broker.start()
                async with mqtt_client(broker) as client:
                    await client.publish("sensors/1", "no number", qos=1, retain=True)
                    await client.publish("sensors/1", "77", qos=1, retain=True)
                    await lab.until("Sensor1.Temperature = 25")

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))


async def sighting(lab: ThingsLab) -> Sighting | None:
    """What is seen of the sensor when somebody asks; None: it cannot be seen."""
    question = Submit(effect="Sensor1.Temperature > 0", recognise=True, waits=False)
    view = await finished(lab.client, await lab.client.submit(question))
    answers = view.findings.answers if view.findings is not None else ()
    return answers[0].sightings[0] if answers and answers[0].sightings else None


TIN = "Tin001: {type: Tin, at: [1, 1.3, 0.8], Shape: {Form: Cylinder, Radius: 0.04, Height: 0.1}}"
SITE_WITH_TIN = SITE.replace("Tin001: {type: Jar, at: [1, 1.3, 0.8]}", TIN) + "types: {Tin: {parent: Graspable}}\n"


def test_a_value_that_cannot_be_does_not_keep_others_from_the_map(tmp_path: Path) -> None:
    mapping = """
connections: {house: {url: "URL"}}
things:
  Lamp1: {type: Light, area: Building001, attributes: {Brightness: {topic: lamp, json: level}, Power: {topic: lamp, json: power}}}
  Lamp2: {type: Light, area: Building001, attributes: {Brightness: {topic: lamp, json: second}}}
"""

    async def test() -> None:
        with MqttBroker(tmp_path) as broker:
            (tmp_path / "lamps.yaml").write_text(mapping.replace("URL", broker.url))
            async with things_lab(tmp_path, {"mappings": ["lamps.yaml"]}) as lab, mqtt_client(broker) as client:
                await client.publish("lamp", '{"level": 400, "power": 7, "second": 30}', qos=1, retain=True)
                await lab.until("Lamp1.Power = 7 AND Lamp2.Brightness = 30")
                assert not await lab.holds("Lamp1.Brightness = ?Level")
                await client.publish("lamp", '{"level": 40, "power": 8, "second": 30}', qos=1, retain=True)
                await lab.until("Lamp1.Brightness = 40")

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))


def test_a_scale_weighs_what_a_robot_puts_on_it(tmp_path: Path) -> None:
    async def test() -> None:
        with MqttBroker(tmp_path) as broker:
            porters = [Porter("Robot1")]
            async with (
                things_lab(tmp_path, settings(tmp_path, broker), SITE_WITH_TIN, porters) as lab,
                mqtt_client(broker) as client,
            ):
                await client.subscribe("scales/1/get")
                await lab.until("Scale1.PositionX = 1")
                assert (await accomplish(lab.client, "Tin001 isOn Scale1")).outcome is Outcome.ACCOMPLISHED
                submission = Submit(effect="Tin001.Weight = ?Weight", recognise=True)
                weighing = asyncio.create_task(finished(lab.client, await lab.client.submit(submission)))
                await anext(aiter(client.messages))
                await client.publish("scales/1", '{"weight": 412, "stable": false}')
                await client.publish("scales/1", '{"weight": 320, "stable": true}')
                assert (await weighing).outcome is Outcome.ACCOMPLISHED
                await lab.until("Tin001.Weight = 320 g")

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))


def test_a_thing_that_announces_itself_joins_with_its_sensors_and_leaves_when_it_withdraws(tmp_path: Path) -> None:
    device = {"ids": ["0x1"], "name": "hall lamp"}
    lamp = {"~": "hall", "schema": "json", "cmd_t": "~/set", "stat_t": "~", "avty_t": "~/availability", "dev": device}
    power = {"name": "power", "stat_t": "hall", "val_tpl": "{{ value_json.power }}", "dev_cla": "power", "unit_of_meas": "W", "dev": device}

    async def test() -> None:
        with MqttBroker(tmp_path) as broker:
            settings = {"connections": {"house": {"url": broker.url}}, "home_assistant": [{"connection": "house"}]}
            async with mqtt_client(broker) as client, things_lab(tmp_path, settings) as lab:
                await client.publish("homeassistant/light/hall/config", json.dumps(lamp), qos=1, retain=True)
                await client.publish("homeassistant/sensor/hall/power/config", json.dumps(power), qos=1, retain=True)
                await client.publish("hall/availability", "online", qos=1, retain=True)
                await client.publish("hall", '{"state": "OFF", "power": 0.5}', qos=1, retain=True)
                await lab.until("HallLamp.On = FALSE AND HallLamp.Working = TRUE AND HallLamp.Power < 2")
                switching = asyncio.create_task(accomplish(lab.client, "HallLamp.On = TRUE"))
                await client.subscribe("hall/set", qos=1)
                async for message in client.messages:
                    assert message.payload == b'{"state": "ON"}'
                    break
                await client.publish("hall", '{"state": "ON", "power": 9.5}', qos=1, retain=True)
                assert (await switching).outcome is Outcome.ACCOMPLISHED
                await lab.until("HallLamp.On = TRUE AND HallLamp.Power > 8")
                await client.publish("homeassistant/light/hall/config", b"", qos=1, retain=True)
                while await lab.client.services():
                    if {offer.provider for offer in await lab.client.services()} == {"Gateway"}:
                        break
                    await asyncio.sleep(0.05)

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))
