"""Traffic as a program of its own, in a building without a simulator."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from somrs.client.client import Addresses
from somrs.deployment.programs import until_stopped
from somrs.deployment.traffic_entrance import PATH
from somrs.errors import UsageError
from somrs.kernel.component import Notified
from somrs.protocol.messages.traffic import CloseWays
from somrs.runtime.host import Host
from somrs.runtime.node import Node, Report
from somrs.storage.journal import Journal

if TYPE_CHECKING:
    from somrs.deployment.traffic_worker import TrafficWorker
    from somrs.traffic.survey import Survey


async def run_traffic(data: Path, addresses: Addresses, host: str, port: int) -> None:
    """Run traffic of a building that is not simulated, on the Repository's map, until this process is asked to stop."""
    if find_spec("scipy") is None:
        raise UsageError("traffic needs additional packages: pip install 'somrs[simulator]'")
    from somrs.deployment.traffic_worker import TrafficWorker
    from somrs.traffic.component import SCHEMA

    data.mkdir(parents=True, exist_ok=True)
    journal = Journal(data / "traffic.sqlite", SCHEMA)
    try:
        runtime = Host(host, port or urlsplit(addresses.traffic or "").port or 0)
        await runtime.start()
        with TrafficWorker() as worker:
            await until_stopped("traffic", add_traffic(runtime, journal, worker, addresses.repository).address)
            await runtime.stop()
    finally:
        journal.close()


def add_traffic(runtime: Host, journal: Journal, worker: TrafficWorker, repository: str) -> Node:
    """Add traffic with this journal to the runtime, and the component that follows the map for it."""
    from somrs.traffic.component import Traffic
    from somrs.traffic.follower import MapFollower
    from somrs.traffic.roadmap import Roadmap
    from somrs.traffic.state import MAP_FOLLOWER, PlanTraffic, RoadmapMade
    from somrs.traffic.survey import Survey

    async def plan(task: object, report: Report) -> object:
        assert isinstance(task, PlanTraffic), "traffic requests nothing else"
        return await worker.plan(task, current().state.roadmap)

    def begin(address: str) -> Traffic:
        return Traffic(address, Roadmap(places=(), lanes=()), follower=MAP_FOLLOWER, edition=int(runtime.clock.now()))

    node = runtime.add_journaled(PATH, begin, journal, carry_out=plan)

    def current() -> Traffic:
        assert isinstance(node.component, Traffic), "it was added as such"
        return node.component

    last_surveys: list[tuple[Survey, CloseWays]] = []
    """The last survey, with its result."""

    async def survey(task: object, report: Report) -> object:
        assert isinstance(task, Survey), "who follows the map requests nothing else"
        state = current().state
        present, astray = tuple(sorted(state.robots)), tuple(state.astray.values())
        question = Survey(map=task.map, ontology=task.ontology, present=present, astray=astray)
        if last_surveys and _is_same(last_surveys[0][0], question):
            return last_surveys[0][1]
        surveyed = await worker.survey(question)
        if surveyed.roadmap != current().state.roadmap:
            node.feed(Notified(RoadmapMade(roadmap=surveyed.roadmap)))
        last_surveys[:] = [(question, surveyed.closing)]
        return surveyed.closing

    runtime.add("/map-follower", lambda address: MapFollower(address, repository, node.address), carry_out=survey)
    return node


def _is_same(earlier: Survey, question: Survey) -> bool:
    """Whether a survey would have the same result. Maps and ontologies are other values after each change."""
    is_same_map = earlier.map is question.map and earlier.ontology is question.ontology
    return is_same_map and (earlier.present, earlier.astray) == (question.present, question.astray)
