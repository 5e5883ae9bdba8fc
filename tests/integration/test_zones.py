"""Zones that operators draw: robots drive around no-go zones, leave those in which they are, and are slow in slow ones."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from msgspec.structs import replace

from somrs.api.remote import LiveApi
from somrs.api.zones import ZoneDrawing
from somrs.client.refusals import NotFound
from somrs.devices.simulator.link.commands import CommandDone, CommandGivenUp, DriveTo
from somrs.devices.simulator.server.driving_distances import find_legs
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import UsageError
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Value
from somrs.space.zones import zones_of
from tests.support.command import somrs
from tests.support.hang import HANG_TIME
from tests.support.simulator_room import ONTOLOGY, Run, robot, shell
from tests.support.small_system import SmallSystem, running


def play(data: Path, scenario: Callable[[SmallSystem, LiveApi], Awaitable[None]]) -> None:
    async def run() -> None:
        async with asyncio.timeout(HANG_TIME), running(data) as (system, api):
            await scenario(system, api)

    asyncio.run(run())


def zone(x: float, y: float, width: float, depth: float, limit: float | None = None, name: str = "Zone1") -> Object:
    values: dict[str, Value] = {"PositionX": x, "PositionY": y, "Shape.Form": "Box", "Shape.Width": width, "Shape.Depth": depth}
    if limit is not None:
        values["SpeedLimit"] = limit
    return Object(name=name, type="NoGoZone" if limit is None else "SlowZone", values=values)


def hall(*robots: Object) -> Map:
    return Map([*shell(), *(robots or [robot("Robot1", (1.5, 3, 0))])])


def draw(run: Run, *zones: Object) -> None:
    run.simulation.set_zones(zones_of(Map([*zones]), ONTOLOGY))


def test_a_robot_drives_around_a_no_go_zone_and_its_quote_is_as_long_as_its_way(world: WorldKind) -> None:
    run = Run(hall(), world)
    (straight,) = find_legs(run.simulation, "Robot1", ((6.5, 3.0),)).lengths
    draw(run, zone(4, 3.5, 1, 3))
    (around,) = find_legs(run.simulation, "Robot1", ((6.5, 3.0),)).lengths
    assert straight is not None
    assert around is not None
    assert around > straight + 0.3
    end, nearest = run.start("Robot1", DriveTo(x=6.5, y=3)), math.inf
    area = zones_of(Map([zone(4, 3.5, 1, 3)]), ONTOLOGY).forbidden[0]

    def step() -> bool:
        nonlocal nearest
        nearest = min(nearest, area.distance(*run.simulation.robots["Robot1"].pose()[:2]))
        return bool(end)

    run.run_until(step)
    assert isinstance(end[0], CommandDone), end
    assert nearest >= run.simulation.robots["Robot1"].size.radius - 0.02


def test_a_zone_across_the_only_way_is_named_in_the_quote_and_by_the_robot(world: WorldKind) -> None:
    run = Run(hall(), world)
    draw(run, zone(4, 3, 1, 6.2))
    legs = find_legs(run.simulation, "Robot1", ((6.5, 3.0),))
    assert (legs.lengths, legs.zones) == ((None,), ("Zone1",))
    end = run.execute("Robot1", DriveTo(x=6.5, y=3))
    assert isinstance(end, CommandGivenUp)
    assert "Zone1 is a no-go zone" in end.description
    draw(run)
    run.execute_all("Robot1", DriveTo(x=6.5, y=3))


def test_a_zone_that_is_drawn_while_a_robot_drives_is_obeyed_at_once(world: WorldKind) -> None:
    run = Run(hall(), world)
    end = run.start("Robot1", DriveTo(x=6.5, y=3))
    run.run_until(lambda: run.simulation.robots["Robot1"].speed > 0.3)
    draw(run, zone(5, 3, 1, 6.2))
    run.run_until(lambda: end)
    assert isinstance(end[0], CommandGivenUp)
    assert "Zone1 is a no-go zone" in end[0].description
    assert run.simulation.robots["Robot1"].pose()[0] < 4.5


@pytest.mark.parametrize("start", [(4.0, 3.0, 0.0), (5.5, 3.0, 0.0)])
def test_a_robot_in_a_no_go_zone_leaves_it_however_deep_it_is_inside(world: WorldKind, start: tuple[float, float, float]) -> None:
    run = Run(hall(robot("Robot1", start)), world)
    draw(run, zone(4, 3, 4, 5))
    run.execute_all("Robot1", DriveTo(x=7, y=3))
    refused = run.execute("Robot1", DriveTo(x=4, y=3))
    assert isinstance(refused, CommandGivenUp)
    assert "Zone1 is a no-go zone" in refused.description


@pytest.mark.parametrize("start", [(3.8, 3.0, 0.0), (4.2, 3.0, 0.0)])
def test_a_robot_leaves_no_go_zones_that_touch_each_other(world: WorldKind, start: tuple[float, float, float]) -> None:
    run = Run(hall(robot("Robot1", start)), world)
    draw(run, zone(3, 3, 2, 6.2), zone(5.5, 3, 3, 6.2, name="Zone2"))
    assert find_legs(run.simulation, "Robot1", ((0.8, 3.0),)).lengths != (None,)
    run.execute_all("Robot1", DriveTo(x=0.8, y=3))


def test_a_robot_in_a_no_go_zone_makes_room_for_nobody_in_it_but_may_be_passed_around(world: WorldKind) -> None:
    run = Run(hall(robot("Robot1", (4, 4.5, 0)), robot("Robot2", (1.5, 1.5, 0))), world)
    draw(run, zone(4, 4.5, 2, 2.5))
    run.execute_all("Robot2", DriveTo(x=6.5, y=1.5))
    assert not run.collisions


def test_robots_are_slow_in_a_slow_zone_and_quotes_count_it(world: WorldKind) -> None:
    run = Run(hall(), world)
    (fast,) = find_legs(run.simulation, "Robot1", ((6.5, 3.0),)).lengths
    draw(run, zone(4, 3, 1.5, 6.2, limit=0.2))
    (slow,) = find_legs(run.simulation, "Robot1", ((6.5, 3.0),)).lengths
    assert fast is not None
    assert slow is not None
    assert fast + 2 < slow < fast + 8, "1.5 m count four times"
    end, highest = run.start("Robot1", DriveTo(x=6.5, y=3)), 0.0

    def step() -> bool:
        nonlocal highest
        driven = run.simulation.robots["Robot1"]
        if abs(driven.pose()[0] - 4) < 0.75:
            highest = max(highest, driven.speed)
        return bool(end)

    run.run_until(step)
    assert isinstance(end[0], CommandDone)
    assert 0.15 < highest < 0.25


def test_zones_are_drawn_changed_and_removed_through_the_api(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        square = ((1.0, 1.0), (3.0, 1.0), (3.0, 2.0), (1.0, 2.0))
        drawn = await api.zones.draw(ZoneDrawing(corners=(square[0], square[2]), by="Ada"))
        assert (drawn.zone.name, drawn.zone.limit) == ("Zone001", None)
        while api.context.version < drawn.version:
            await asyncio.sleep(0.01)
        (zone,) = (await api.zones.list()).zones
        assert (zone.name, zone.corners, zone.storey) == ("Zone001", square, "Storey001")
        assert (await api.map.history("Zone001")).events[0].author == "Ada"
        slow = await api.zones.draw(ZoneDrawing(name="Zone001", corners=square[:3], limit=0.4))
        while api.context.version < slow.version:
            await asyncio.sleep(0.01)
        (zone,) = (await api.zones.list()).zones
        assert (zone.corners, zone.limit) == (square[:3], 0.4)
        await api.zones.remove("Zone001")
        while (await api.zones.list()).zones:
            await asyncio.sleep(0.01)

    play(tmp_path, scenario)


def test_what_is_no_zone_is_refused_with_the_reason(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        triangle = ((1.0, 1.0), (3.0, 1.0), (3.0, 2.0))
        for drawing, reason in (
            (ZoneDrawing(corners=triangle[:1]), "three or more corners"),
            (ZoneDrawing(corners=((0.0, 0.0), (1.0, 1.0), (2.0, 2.0))), "lie on one line"),
            (ZoneDrawing(corners=((0.0, 0.0), (4.0, 4.0), (4.0, 0.0), (1.0, 3.0))), "its sides cross"),
            (ZoneDrawing(corners=triangle, limit=0.0), "more than 0 m/s"),
            (ZoneDrawing(corners=triangle, name="Jar001"), "Jar001 is a Jar, and no zone"),
            (ZoneDrawing(corners=triangle, name="NoGoZone"), "NoGoZone is the name of a type"),
            (ZoneDrawing(corners=triangle, storey="Storey2"), "there is no storey Storey2"),
        ):
            with pytest.raises((UsageError, NotFound), match=reason):
                await api.zones.draw(drawing)
        with pytest.raises(NotFound, match="there is no zone Zone009"):
            await api.zones.remove("Zone009")

    play(tmp_path, scenario)


def test_the_command_draws_lists_and_removes_zones(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        replace(system.addresses, api=api.client.url).write(system.data)
        drawn = await asyncio.to_thread(somrs, "zone", "Wet", "--corners", "1,1 3,2", "--limit", "0.3", "--data", str(system.data))
        assert "at most 0.3 m/s" in drawn.stdout
        while "Wet" not in {zone.name for zone in (await api.zones.list()).zones}:
            await asyncio.sleep(0.01)
        listed = await asyncio.to_thread(somrs, "zone", "--data", str(system.data), "--json")
        assert json.loads(listed.stdout)["zones"][0]["corners"] == [[1.0, 1.0], [3.0, 1.0], [3.0, 2.0], [1.0, 2.0]]
        wrong = await asyncio.to_thread(somrs, "zone", "Dry", "--corners", "1,1 3", "--data", str(system.data))
        assert wrong.returncode == 2
        assert "corners are written as" in wrong.stderr
        removed = await asyncio.to_thread(somrs, "zone", "Wet", "--remove", "--data", str(system.data))
        assert removed.stdout == "Wet was removed\n"

    play(tmp_path, scenario)
