"""Simulated lifts and doors at a broker.

python -m somrs.adapters.things.simulated --broker mqtt://localhost:1883 --lift lifts/1=0,1,2 --door doors/entrance
"""

from __future__ import annotations

import argparse
import asyncio
from urllib.parse import urlsplit

import aiomqtt

from somrs.adapters.things.simulated.body import KinematicPassage
from somrs.adapters.things.simulated.controller import PassageController
from somrs.adapters.things.simulated.servers import move, serve_mqtt

STOREY = 4.0
"""From one level of a lift to the next, m."""


def _controllers(lifts: list[str], doors: list[str]) -> dict[str, PassageController]:
    controllers = {door: PassageController(KinematicPassage({})) for door in doors}
    for lift in lifts:
        topic, _, names = lift.partition("=")
        levels = {name: STOREY * number for number, name in enumerate(names.split(","))}
        controllers[topic] = PassageController(KinematicPassage(levels))
    return controllers


async def _run(broker: str, controllers: dict[str, PassageController]) -> None:
    address = urlsplit(broker)

    def connect(will: aiomqtt.Will) -> aiomqtt.Client:
        return aiomqtt.Client(address.hostname or "localhost", address.port or 1883, will=will)

    async with asyncio.TaskGroup() as group:
        group.create_task(move(controllers))
        for topic, controller in controllers.items():
            group.create_task(serve_mqtt(connect, topic, controller))


def main() -> None:
    parser = argparse.ArgumentParser(description="Simulated lifts and doors with the session interface, at an MQTT broker")
    parser.add_argument("--broker", default="mqtt://localhost:1883")
    parser.add_argument("--lift", action="append", default=[], metavar="TOPIC=LEVEL,LEVEL,...")
    parser.add_argument("--door", action="append", default=[], metavar="TOPIC")
    arguments = parser.parse_args()
    asyncio.run(_run(arguments.broker, _controllers(arguments.lift, arguments.door)))


if __name__ == "__main__":
    main()
