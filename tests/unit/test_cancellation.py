"""Who waits for something ends when it is cancelled, whatever comes at the same time."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import aiomqtt
import pytest

import somrs

Wait = Callable[[asyncio.Future[int]], Awaitable[object]]


def by_asyncio(timeout: float | None) -> Wait:
    return lambda future: asyncio.wait_for(future, timeout)


def by_aiomqtt(future: asyncio.Future[int]) -> Awaitable[object]:
    return aiomqtt.Client("127.0.0.1")._wait_for(future, None)


@pytest.mark.parametrize("wait", [by_asyncio(60), by_asyncio(None), by_aiomqtt])
@pytest.mark.parametrize("fails", [True, False])
@pytest.mark.parametrize("result_first", [True, False])
def test_a_cancellation_that_comes_with_the_result_is_not_lost(wait: Wait, fails: bool, result_first: bool) -> None:
    assert somrs.__version__

    async def test() -> None:
        future: asyncio.Future[int] = asyncio.get_running_loop().create_future()

        async def waiting() -> None:
            await wait(future)

        task = asyncio.create_task(waiting())
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        if not result_first:
            task.cancel()
        if not future.done():
            future.set_exception(OSError("cut off")) if fails else future.set_result(1)
        if result_first:
            task.cancel()
        await asyncio.wait([task])
        assert task.cancelled()

    asyncio.run(test())


@pytest.mark.parametrize("timeout", [0, -1, 0.001])
def test_what_takes_too_long_ends(timeout: float) -> None:
    async def test() -> None:
        began = False

        async def work() -> None:
            nonlocal began
            began = True
            await asyncio.Event().wait()

        with pytest.raises(TimeoutError):
            await asyncio.wait_for(work(), timeout)
        assert began == (timeout > 0)

    asyncio.run(test())


def test_what_is_there_already_needs_no_time() -> None:
    async def test() -> None:
        future: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        future.set_result(7)
        assert await asyncio.wait_for(future, 0) == 7

    asyncio.run(test())
