"""Traffic as a program of its own, in a building without a simulator."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from msgspec import structs

from somrs.client.addresses import Addresses
from somrs.deployment.programs import until_stopped
from somrs.deployment.traffic_entrance import PATH
from somrs.errors import UsageError
from somrs.kernel.component import Notified
from somrs.runtime.host import Host
from somrs.runtime.node import Node, Report
from somrs.storage.journal import Journal

if TYPE_CHECKING:
    from somrs.deployment.traffic_worker import TrafficWorker
    from somrs.traffic.component import Traffic
    from somrs.traffic.notices import CloseWays
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
        runtime = Host(host, port or urlsplit(addresses.traffic or "").port or 0, bus=addresses.bus)
        await runtime.start()
        with TrafficWorker() as worker:
            node = add_traffic(runtime, journal, worker, addresses.repository)
            await runtime.listening()
            await until_stopped("traffic", node.address)
            await runtime.stop()
    finally:
        journal.close()


def add_traffic(runtime: Host, journal: Journal, worker: TrafficWorker, repository: str) -> Node:
    """Add traffic with this journal to the runtime, and the component that follows the map for it."""
    from somrs.traffic.component import Traffic
    from somrs.traffic.follower import MapFollower
    from somrs.traffic.notices import CloseWays, HoldTraffic, RoadmapExpected
    from somrs.traffic.roadmap import Roadmap
    from somrs.traffic.state import PlanTraffic

    async def plan(task: object, report: Report) -> object:
        assert isinstance(task, PlanTraffic), "traffic requests nothing else"
        return await worker.plan(task, _traffic_of(node).state.roadmap)

    def begin(address: str) -> Traffic:
        return Traffic(address, Roadmap(places=(), lanes=()), edition=int(runtime.clock.now()))

    node = runtime.add_journaled(PATH, begin, journal, carry_out=plan, recovers=True)
    node.feed(Notified(RoadmapExpected(False)))  # it may have been so when an earlier program ended
    surveys = _Surveys(node, worker)

    async def work(task: object, report: Report) -> object:
        if isinstance(task, CloseWays | HoldTraffic):
            node.feed(Notified(task))
            return None
        return await surveys.carry_out(task, report)

    runtime.add("/map-follower", lambda address: MapFollower(address, repository), carry_out=work)
    return node


def _traffic_of(node: Node) -> Traffic:
    from somrs.traffic.component import Traffic

    assert isinstance(node.component, Traffic), "it was added as such"
    return node.component


class _Surveys:
    """The surveys for who follows the map. `node`: that of traffic."""

    def __init__(self, node: Node, worker: TrafficWorker) -> None:
        self._node, self._worker = node, worker
        self._last_survey: tuple[Survey, CloseWays] | None = None

    async def carry_out(self, task: object, report: Report) -> object:
        """What is closed now. If there is another roadmap, traffic gets it before."""
        from somrs.traffic.survey import Survey

        assert isinstance(task, Survey), "who follows the map requests nothing else"
        state = _traffic_of(self._node).state
        survey = structs.replace(task, present=tuple(sorted(state.robots)), astray=tuple(state.astray.values()))
        if self._last_survey is not None and _is_same(self._last_survey[0], survey):
            return self._last_survey[1]
        surveyed = await self._worker.survey(survey)
        if surveyed.roadmap != state.roadmap:
            return await self._replace(survey)
        self._last_survey = survey, surveyed.closing
        return surveyed.closing

    async def _replace(self, survey: Survey) -> CloseWays:
        """Have traffic use another roadmap, on which the places of all robots are closed until they enter anew."""
        from somrs.traffic.notices import RoadmapExpected, RoadmapMade

        self._node.feed(Notified(RoadmapExpected(True)))
        try:
            while True:
                traffic = _traffic_of(self._node)
                robots = {name: traffic.positions(name) for name in traffic.state.robots}
                astray = (*traffic.state.astray.values(), *robots.values())
                surveyed = await self._worker.survey(structs.replace(survey, present=(), astray=astray))
                if all({*traffic.positions(name)} <= {*robots.get(name, ())} for name in traffic.state.robots):
                    break  # nobody has entered meanwhile
        except BaseException:  # also when it is cancelled: robots may enter again on the roadmap that there is
            self._node.feed(Notified(RoadmapExpected(False)))
            raise
        self._node.feed(Notified(RoadmapMade(roadmap=surveyed.roadmap, closing=surveyed.closing)))
        return surveyed.closing


def _is_same(earlier: Survey, question: Survey) -> bool:
    """Whether a survey would have the same result. Maps and ontologies are other values after each change."""
    is_same_map = earlier.map is question.map and earlier.ontology is question.ontology
    return is_same_map and (earlier.present, earlier.astray) == (question.present, question.astray)
