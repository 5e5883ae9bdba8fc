"""The process that does the work for traffic gives the same as the work done here, also after it was killed."""

from __future__ import annotations

import asyncio
import os
import signal
from random import Random

import pytest
from msgspec import structs

from somrs.deployment.traffic_worker import TrafficWorker
from somrs.errors import RemoteError
from somrs.kernel.component import Answered, Ask, Received
from somrs.ontology.objects import ObjectAdded
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.traffic import EnterTraffic, RequestTrip
from somrs.traffic.component import Traffic
from somrs.traffic.layout import Layout, lay_out
from somrs.traffic.planner import TrafficPlanner
from somrs.traffic.roadmap import Roadmap, RobotKind
from somrs.traffic.state import PlanQuestion, PlanTraffic, TrafficPlan
from somrs.traffic.survey import Survey, Surveyor
from tests.support.hang import HANG_TIME
from tests.support.simulated_tower import HEIGHT, tower
from tests.support.simulator_room import ONTOLOGY

BUILDING = tower((2, 2, 0))
LAYOUT = Layout(map=BUILDING, ontology=ONTOLOGY, levels=(0.0, HEIGHT), kinds=(RobotKind(0.27),))


def problem(roadmap: Roadmap) -> PlanTraffic:
    """What is to be planned when a robot has asked for a trip across a storey."""
    traffic = Traffic("traffic", roadmap)
    start, *_, destination = (place.name for place in roadmap.places if place.level == 0.0 and not place.zone)
    header = Header(sender="Robot1", recipient="traffic", message_id="m1", reply_to="Robot1")
    traffic.handle(Received(Message(header=header, body=EnterTraffic(robot="Robot1", place=start, lease=60.0))), 1.0)
    traffic.handle(Answered(PlanQuestion(traffic.state.serial), TrafficPlan(ways={})), 2.0)
    fence = traffic.state.robots["Robot1"].fence
    trip = RequestTrip(robot="Robot1", fence=fence, number=1, trip="trip", destination=destination)
    effects = traffic.handle(Received(Message(header=header, body=trip)), 10.0)
    return next(effect.task for effect in effects if isinstance(effect, Ask) and isinstance(effect.task, PlanTraffic))


def test_the_work_is_the_same_in_the_process() -> None:
    async def run() -> None:
        survey = Survey(map=BUILDING, ontology=ONTOLOGY)
        with TrafficWorker() as worker:
            roadmap = await worker.lay_out(LAYOUT)
            assert roadmap == lay_out(LAYOUT.building, LAYOUT.kinds)
            assert await worker.survey(survey) == Surveyor().survey(survey)
            planned = TrafficPlanner(roadmap, Random()).plan(problem(roadmap))
            assert planned.ways["Robot1"][0] != planned.ways["Robot1"][-1]
            assert await worker.plan(problem(roadmap), roadmap) == planned
            assert worker.pid is not None
            os.kill(worker.pid, signal.SIGKILL)
            assert await worker.plan(problem(roadmap), roadmap) == planned
            os.kill(worker.pid, signal.SIGKILL)
            assert await worker.survey(survey) == Surveyor().survey(survey)

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


def test_what_cannot_be_done_is_told() -> None:
    async def run() -> None:
        table = BUILDING.objects["Table1"]
        walled = structs.replace(table, name="Walled", values={**table.values, "PositionX": float("inf")})
        layout = structs.replace(LAYOUT, map=BUILDING.changed([ObjectAdded(walled)]))
        with TrafficWorker() as worker, pytest.raises(RemoteError, match="Walled"):
            await worker.lay_out(layout)

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))
