"""The API as its clients in other processes have it: values, refusals and news are those of the API itself, and it may come and go."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import get_type_hints
from urllib.parse import urlsplit

import httpx
import msgspec
import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.routing import Mount
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from somrs.api.formulas import CheckFormula
from somrs.api.map_news import MapNews
from somrs.api.program import served
from somrs.api.remote import Api, LiveApi, live_api
from somrs.api.service import open_api_service
from somrs.api.topics import TOPICS
from somrs.client.api_client import ApiClient
from somrs.client.client import Client
from somrs.client.hub import News
from somrs.client.live_news import CONNECTION
from somrs.client.operations import Document, operations
from somrs.client.refusals import NotFound, Refused
from somrs.errors import FormulaError, UsageError
from somrs.gui.proxy import Proxy
from somrs.ontology.objects import Object, ObjectAdded, ValueSet
from somrs.ports import listen_at
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.orders import TemplateSaved
from somrs.protocol.messages.submission import Submit
from somrs.runtime.bounded_http import QuietServer
from somrs.runtime.wire import Unanswered
from tests.support.hang import HANG_TIME
from tests.support.small_system import LOOPBACK, SmallSystem, running, scheduler_at


class Program:
    """The API, to be ended and started again at its port."""

    def __init__(self, system: SmallSystem) -> None:
        self._system, self._port = system, 0
        self._stack = AsyncExitStack()

    async def start(self) -> str:
        await self._stack.enter_async_context(scheduler_at(self._system))
        api = await self._stack.enter_async_context(open_api_service(self._system.addresses, self._system.data))
        url = await self._stack.enter_async_context(served(api, listen_at(LOOPBACK, self._port)))
        self._port = urlsplit(url).port or 0
        return url

    async def stop(self) -> None:
        await self._stack.aclose()


def run_scenario(data: Path, scenario: Callable[[SmallSystem, Program, LiveApi], Awaitable[None]]) -> None:
    async def run() -> None:
        system = SmallSystem(data, [])
        program = Program(system)
        async with asyncio.timeout(HANG_TIME), AsyncExitStack() as stack:
            stack.push_async_callback(system.stop)
            await system.start()
            stack.push_async_callback(program.stop)
            api = await stack.enter_async_context(live_api(await program.start()))
            await scenario(system, program, api)

    asyncio.run(run())


async def wait_until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(HANG_TIME):
        while not condition():
            await asyncio.sleep(0.02)


def test_the_map_here_is_that_of_the_repository_and_is_not_sent_again(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, program: Program, api: LiveApi) -> None:
        place = {"PositionX": 1.0, "PositionY": 1.0, "PositionZ": 0.8}
        additions = tuple(ObjectAdded(Object(name=f"Tin{number:04}", type="Jar", values=dict(place))) for number in range(5000))
        for begin in range(0, 5000, 500):
            version = (await api.map.change(UpdateMap(changes=additions[begin : begin + 500]))).version
        await wait_until(lambda: api.context.version >= version)
        first_version, read = version, api.context._read_map
        api.context._read_map = None  # type: ignore[method-assign,assignment]  # it is not to be read any more
        with api.context.hub.subscribe("map") as listening:
            await listening.wait_until_followed()
            for number in range(20):
                version = (await api.map.change(UpdateMap(changes=(ValueSet("Tin0001", "Weight", 1 + number / 10),)))).version
            while api.context.version < version:
                news = (await listening.next_news()).value
                assert isinstance(news, MapNews)
                if news.version <= first_version:
                    continue  # what was read at the beginning
                assert len(news.changes) == 1
                assert api.context.version >= news.version, "the copy here is not behind what is told"
        async with Client(system.addresses) as client:
            assert api.context.map == await client.map()
            assert [*api.context.ontology] == [*await client.ontology()]
        good, wrong = [await api.formulas.check(CheckFormula(text=f"{name} isOn ?Where: Platform")) for name in ("Tin0001", "Tin9999")]
        assert (good.ok, [mistake.position for mistake in wrong.problems]) == (True, [0]), "what is typed is checked by the copy"
        api.context._read_map = read  # type: ignore[method-assign]

    run_scenario(tmp_path / "data", scenario)


def test_refusals_are_those_of_the_api(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, program: Program, api: LiveApi) -> None:
        with pytest.raises(FormulaError) as wrong:
            await api.orders.save_template("Bring", TemplateSaved(task=Submit(effect="Jar001 isOn Nothing")))
        assert (wrong.value.text, wrong.value.position) == ("Jar001 isOn Nothing", 12)
        with pytest.raises(Refused) as refused:
            await api.map.change(UpdateMap(changes=(ValueSet("Nothing", "Weight", 1.0),)))
        assert refused.value.broken
        with pytest.raises(NotFound, match="there is no task"):
            await api.tasks.read("nothing")
        with pytest.raises(UsageError, match="is not a name"):
            await api.map.history("a/b")
        with pytest.raises(TypeError):
            await api.map.history("Jar001", most=3)  # type: ignore[call-arg]
        document = await api.map.export()
        assert (document.name, document.media_type) == ("site.yaml", "application/yaml")

    run_scenario(tmp_path / "data", scenario)


def test_the_api_may_go_and_come_back(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, program: Program, api: LiveApi) -> None:
        hub = api.context.hub
        with hub.subscribe("map", CONNECTION, "tasks") as listening:
            await listening.wait_until_followed()
            await program.stop()
            assert await listening.next_news() == News(topic=CONNECTION, value=False)
            with pytest.raises(Unanswered, match=r"does not answer.*`somrs up` starts it"):
                await api.map.query("?Thing isOn ?Where")
            with hub.subscribe("fleet") as fleet_listening:
                await fleet_listening.wait_until_followed()  # nobody waits for what is away
            assert "Jar001" in api.context.map.objects, "what was known still is"
            async with Client(system.addresses) as client:
                version = await client.update(UpdateMap(changes=(ValueSet("Jar001", "Weight", 0.7),)))
            await program.start()
            received_news = [await listening.next_news() for _ in range(3)]
            assert received_news == [
                News(topic=CONNECTION, value=True),
                News(topic="map", missed=True),
                News(topic="tasks", missed=True),
            ]
            assert api.context.version == version
            assert api.context.map.objects["Jar001"].values["Weight"] == 0.7
            await api.map.change(UpdateMap(changes=(ValueSet("Jar001", "Weight", 0.8),)))
            assert (await listening.next_news()).topic == "map"

    run_scenario(tmp_path / "data", scenario)


def test_who_waits_for_a_change_gets_it_when_the_connection_is_back(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, program: Program, api: LiveApi) -> None:
        await api.context.wait_for_version(api.context.version)
        await program.stop()
        async with Client(system.addresses) as client:
            added = ObjectAdded(Object(name="Tin0001", type="Jar", values={"PositionX": 1.0, "PositionY": 1.0, "PositionZ": 0.8}))
            version = (await client.report(UpdateMap(changes=(added,)))).version
        waiting = asyncio.create_task(api.context.wait_for_version(version))
        await wait_until(lambda: not api.context.hub.connected)
        assert not waiting.done()
        await program.start()
        await waiting
        assert "Tin0001" in api.context.map.objects

    run_scenario(tmp_path, scenario)


def test_topics_come_and_go_on_one_connection_and_nothing_is_lost(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, program: Program, api: LiveApi) -> None:
        async def listener(number: int) -> None:
            for turn in range(10):
                with api.context.hub.subscribe("templates") as listening:
                    await listening.wait_until_followed()
                    api_changed.clear()
                    asyncio.get_running_loop().call_later(0.001 * number, api_changed.set)
                    await asyncio.wait_for(api_changed.wait(), HANG_TIME)
                    if number == 0:
                        await api.orders.save_template(f"T{turn}", template)
                        assert (await asyncio.wait_for(listening.next_news(), HANG_TIME)).topic == "templates"

        template = TemplateSaved(task=Submit(effect="Jar001 isOn Platform001"))
        api_changed = asyncio.Event()
        await asyncio.gather(*map(listener, range(4)))

    run_scenario(tmp_path / "data", scenario)


def test_every_topic_has_its_values(tmp_path: Path) -> None:
    async def run() -> None:
        async with asyncio.timeout(HANG_TIME), running(tmp_path / "data") as (system, api):
            system.addresses.write(system.data)
            with api.context.hub.subscribe("system", "fleet", "questions", "tasks") as listening:
                topic_values: dict[str, object] = {}
                while len(topic_values) < 4:
                    news = await listening.next_news()
                    if not news.missed:
                        topic_values[news.topic] = news.value
            for topic, value in topic_values.items():
                assert isinstance(value, TOPICS[topic])

    asyncio.run(run())


def test_answers_of_all_operations_can_be_read() -> None:
    for group, declared in get_type_hints(Api).items():
        for operation in operations(group, declared):
            if operation.returns is not Document:
                msgspec.json.Decoder(operation.returns)


@asynccontextmanager
async def proxy(url: str) -> AsyncIterator[str]:
    """A server that has the API of another below its own `/api`."""
    listening = listen_at(LOOPBACK, 0)
    async with ApiClient(url) as client:
        server = QuietServer(uvicorn.Config(Starlette(routes=[Mount("/api", Proxy(client))]), log_level="warning", ws="websockets-sansio"))
        serving = asyncio.create_task(server.serve(sockets=[listening]))
        while not server.started:
            await asyncio.sleep(0.01)
        try:
            yield f"{LOOPBACK}:{listening.getsockname()[1]}/api"
        finally:
            server.end()
            await serving


def test_browsers_have_the_api_below_the_windows_own_address(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, program: Program, api: LiveApi) -> None:
        async with proxy(api.client.url) as place, httpx.AsyncClient(base_url=f"http://{place}") as browser:
            for path in ("/map", "/openapi.json", "/map/query?formula=%3FX%20isOn%20Platform001", "/map/export.yaml", "/"):
                direct = await browser.get(f"{api.client.url}{path}")
                passed = await browser.get(path)
                assert (passed.status_code, passed.content) == (200, direct.content), path
                assert passed.headers["content-type"] == direct.headers["content-type"]
            assert (await browser.get("/map/export.yaml")).headers["content-disposition"] == 'attachment; filename="site.yaml"'
            wrong = await browser.get("/map/query", params={"formula": "Jar001 isOn"})
            assert (wrong.status_code, wrong.json()["error"]) == (400, "RequestMistaken")
            body = msgspec.json.encode(UpdateMap(changes=(ValueSet("Jar001", "Weight", 0.4),)))
            async with connect(f"ws://{place}/live") as live:
                await live.send('{"follow": ["map"], "confirm": 1}')
                assert await live.recv() == '{"confirmed":1}'
                assert (await browser.post("/map/changes", content=body, headers={"Content-Type": "application/json"})).json()[
                    "version"
                ] == 1
                assert msgspec.json.decode(await live.recv())["value"]["version"] == 1
                async with connect(f"ws://{place}/poses") as poses:
                    assert isinstance(await poses.recv(), str)
                    assert isinstance(await poses.recv(), bytes)
                await program.stop()
                with pytest.raises(ConnectionClosed):
                    await live.recv()
            silent = await browser.get("/map")
            assert (silent.status_code, silent.json()["error"]) == (503, "Unanswered")
            with pytest.raises(Exception, match="rejected"):
                await connect(f"ws://{place}/live")
            await program.start()
            assert (await browser.get("/map")).status_code == 200

    run_scenario(tmp_path / "data", scenario)


def test_what_is_said_at_the_live_socket_must_be_understood(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, program: Program, api: LiveApi) -> None:
        async with connect(f"ws{api.client.url.removeprefix('http')}/live") as live:
            await live.send('{"follow": 3}')
            with pytest.raises(ConnectionClosed, match="send the topics to follow"):
                await live.recv()

    run_scenario(tmp_path / "data", scenario)


def test_a_topic_that_does_not_exist_is_answered_with_those_that_do_and_the_others_are_followed(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, program: Program, api: LiveApi) -> None:
        async with connect(f"ws{api.client.url.removeprefix('http')}/live") as live:
            await live.send('{"follow": ["maps", "map", "task", "map 2"], "confirm": 1}')
            refused = msgspec.json.decode(await live.recv())
            assert refused["error"] == "NotFound"
            assert refused["problem"] == (
                "there is no topic map 2 or maps or task; the topics are map, ontology, services, fleet, traffic, tasks, "
                "task ID, templates, orders, people, questions, system. The other topics of the message are followed"
            )
            assert await live.recv() == '{"confirmed":1}'
            await api.map.change(UpdateMap(changes=(ValueSet("Jar001", "Weight", 0.7),)))
            assert msgspec.json.decode(await live.recv())["topic"] == "map"
            await live.send('{"follow": ["templates", "orders", "task urn:uuid:1"], "confirm": 2}')
            assert await live.recv() == '{"confirmed":2}'

    run_scenario(tmp_path / "data", scenario)


def test_a_mistake_in_the_body_is_answered_with_its_place(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, program: Program, api: LiveApi) -> None:
        async with httpx.AsyncClient(base_url=api.client.url) as client:
            formula = (await client.post("/tasks", json={"effect": "Jar002 isOn Platfrom001"})).json()
            assert (formula["error"], formula["text"], formula["position"]) == ("FormulaError", "Jar002 isOn Platfrom001", 12)
            assert (formula["problem"], formula["hint"]) == (
                "there is no object Platfrom001 on the map",
                "did you mean Platform001?",
            )
            for path, body, problem in (
                (
                    "/tasks",
                    {"effect": "Jar002 isOn Platform001", "waitss": False},
                    "the body: there is no field waitss; did you mean waits?",
                ),
                (
                    "/map/changes",
                    {"situation": "Jar001 isOn Platform001", "observation": {"AsOf": 3}},
                    "the body: there is no field observation.AsOf; did you mean as_of?",
                ),
                (
                    "/map/changes",
                    {"changes": [{"type": "ValueSet", "object": "Jar001", "path": "Weight", "value": 1, "unit": "g"}]},
                    "the body: there is no field changes[0].unit; there are object, path, value",
                ),
            ):
                answer = await client.post(path, json=body)
                assert answer.status_code == 400, body
                assert answer.json()["problem"].startswith(problem)
            two = {"changes": [{"type": "ValueSet", "object": name, "path": "Weight", "value": 99} for name in ("Jar001", "Jar002")]}
            assert len((await client.post("/map/changes", json=two)).json()["problems"]) == 2

    run_scenario(tmp_path / "data", scenario)


@pytest.mark.parametrize("at", ["the API", "the windows"])
def test_an_unknown_path_and_a_wrong_method_are_answered_with_a_problem(tmp_path: Path, at: str) -> None:
    async def scenario(system: SmallSystem, program: Program, api: LiveApi) -> None:
        async with proxy(api.client.url) as place, httpx.AsyncClient() as client:
            base = api.client.url if at == "the API" else f"http://{place}"
            for method, path, status, problem in (
                ("GET", "/nope", 404, "there is no /api/nope; /api/openapi.json describes what there is"),
                ("GET", "/task", 404, "there is no /api/task; did you mean /api/tasks"),
                ("PUT", "/map/nope/nope", 404, "there is no /api/map/nope/nope"),
                ("GET", "/page/nope", 404, "there is no /api/page/nope"),
                ("GET", "/live", 404, "/api/live is a WebSocket"),
                ("PUT", "/tasks", 405, "/api/tasks has no PUT; it has GET and POST"),
                ("PATCH", "/templates/Bring", 405, "/api/templates/Bring has no PATCH; it has DELETE and GET and PUT"),
                ("DELETE", "/", 405, "/api/ has no DELETE; it has GET"),
                ("OPTIONS", "/map", 405, "/api/map has no OPTIONS; it has GET"),
            ):
                answer = await client.request(method, f"{base}{path}")
                assert answer.status_code == status, (method, path)
                assert answer.headers["content-type"] == "application/json"
                assert answer.json()["problem"].startswith(problem)
                assert answer.json()["error"] == {404: "NotFound", 405: "WrongMethod"}[status]
                if status == 405:
                    assert answer.headers["allow"].split(", ") == problem.partition("; it has ")[2].split(" and ")
            with pytest.raises(InvalidStatus) as denied:
                await connect(f"ws{base.removeprefix('http')}/nope")
            assert denied.value.response.status_code == 404
            assert "/api/live and /api/poses" in msgspec.json.decode(denied.value.response.body or b"")["problem"]

    run_scenario(tmp_path / "data", scenario)


def test_no_websocket_makes_the_api_follow_thousands_of_tasks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOMRS_LIMIT_FOLLOWED_TASKS", "300")

    async def scenario(system: SmallSystem, program: Program, api: LiveApi) -> None:
        url = f"{api.client.url.replace('http', 'ws', 1)}/live"
        async with connect(url) as greedy_socket, connect(url) as second_socket:
            for number, limit_text in enumerate(["follows at most 200 tasks"] * 5):
                topics = [*(f"task {number}-{task}" for task in range(5000)), "map"]
                await greedy_socket.send(msgspec.json.encode({"follow": topics, "confirm": number}).decode())
                assert limit_text in await answer_with(greedy_socket, "problem")
                assert str(number) in await answer_with(greedy_socket, "confirmed")
            assert (await api.tasks.list()).rows == ()
            topics = [f"task {task}" for task in range(200)]
            await second_socket.send(msgspec.json.encode({"follow": topics}).decode())
            assert "300 tasks are followed, which is the limit" in await answer_with(second_socket, "problem")
            follow_the_same = msgspec.json.encode({"follow": [f"task 4-{task}" for task in range(200)], "confirm": 1}).decode()
            await second_socket.send(follow_the_same)
            assert "limit" not in await answer_with(second_socket, "confirmed"), "these are followed already"

    run_scenario(tmp_path / "data", scenario)


async def answer_with(socket: ClientConnection, field: str) -> str:
    """The next message with this field, behind news."""
    while field not in msgspec.json.decode(text := await socket.recv()):
        pass
    return str(text)
