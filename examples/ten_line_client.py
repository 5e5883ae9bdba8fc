"""Submits a task to the system that `somrs up` has started, and follows it until it ends."""

import asyncio

from somrs import Client


async def main() -> None:
    async with Client() as system:
        task = await system.submit("Jar002 isOn Platform001")
        async for view in system.watch(task):
            print(view.phase, *(f"{step.service or 'not arranged'}: {step.state}" for step in view.steps))
        print(view.outcome, view.explanation, await system.query("?Thing isOn Platform001"))


asyncio.run(main())
