"""What things weigh in the simulated world: scales and robots find it out, and a robot puts down what is too heavy for it."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.devices.simulator.drivers.manipulator import Manipulator
from somrs.devices.simulator.drivers.scale import Scale
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.link import OperatorLink, RobotLink
from somrs.errors import UsageError
from somrs.service_manager.sdk.orders import Quote, Refusal, ServiceFailed
from tests.support.building import building
from tests.support.robot_lab import map_after, run, run_work, simulator
from tests.support.simulated_device_harness import simulated

SITE = (
    "types:\n  Parcel: {parent: Graspable, doc: Nobody knows what it weighs before it is weighed}\n"
    + building("Lab", 8, 6)
    + """
  Table1: {type: Table, at: [1, 4, 0], Shape: {Form: Box, Width: 0.6, Depth: 1, Height: 0.7}}
  Scale1: {type: Scale, at: [6, 4, 0], Price: 0.1 EUR}
  Parcel1: {type: Parcel, at: [6, 4, 0.1], Shape: {Form: Box, Width: 0.1, Depth: 0.1, Height: 0.2}}
  Parcel2: {type: Parcel, at: [1.15, 3.7, 0.7], Shape: {Form: Box, Width: 0.1, Depth: 0.1, Height: 0.15}}
  Jar1: {type: Jar, at: [1.15, 4.2, 0.7]}
  Robot1: {type: PioneerP3DX, at: [2, 1.5, 0], Payload: 2 kg}
facts:
  - Parcel1 isOn Scale1
  - Parcel2 isOn Table1
  - Jar1 isOn Table1
"""
)
"""Parcel1 has a volume of 2 l, and Parcel2 one of 1.5 l: that of the water that weighs as much."""


def test_a_scale_weighs_what_stands_on_it_alone() -> None:
    async def test() -> None:
        async with simulated(Scale, "Scale1", SITE) as harness:
            assert (await harness.quote("WeighObject", Object="Parcel1")).price == 0.1
            assert (await harness.perform("WeighObject", Object="Parcel1")).objects["Parcel1"].values["Weight"] == 2.0
            await harness.operator.set_weight("Parcel1", 3.127)
            assert (await harness.perform("WeighObject", Object="Parcel1")).objects["Parcel1"].values["Weight"] == 3.13
            with pytest.raises(Refusal, match="Parcel2 does not stand on Scale1") as refused:
                await harness.quote("WeighObject", Object="Parcel2")
            assert refused.value.condition == "Parcel2 isOn Scale1"
            await harness.operator.move("Jar1", 6.12, 4.12, 0.1)
            with pytest.raises(ServiceFailed, match="Jar1 is on Scale1, too"):
                await harness.perform("WeighObject", Object="Parcel1")

    run(test())


def test_a_scale_refuses_what_is_not_alone_on_the_map_and_says_what_would_help() -> None:
    async def test() -> None:
        async with simulated(Scale, "Scale1", SITE) as harness:
            order = structs.replace(harness.order("WeighObject", Object="Parcel1"), situation="Jar1 isOn Scale1")
            with pytest.raises(Refusal, match="Jar1 is on it, too") as refused:
                await run_work(harness.device, Quote(order), harness.repository, [])
            assert refused.value.condition == "NOT Jar1 isOn Scale1"

    run(test())


def test_a_scale_accepts_no_other_commands() -> None:
    async def test() -> None:
        async with simulator(text=SITE) as server, RobotLink(server.host, server.port, "Scale1") as scale:
            with pytest.raises(RobotGaveUp, match="Scale1 is a scale"):
                await scale.drive_to(1, 1)
            with pytest.raises(RobotGaveUp, match="Parcel2 does not stand on Scale1"):
                await scale.weigh("Parcel2")
            assert (await scale.stop()).state.x == 6

    run(test())


def test_a_robot_weighs_a_thing_by_lifting_it_a_little() -> None:
    async def test() -> None:
        async with simulated(Manipulator, "Robot1", SITE) as harness:
            await harness.operator.set_weight("Parcel2", 2.6)
            map = await harness.perform("WeighObject", Object="Parcel2")
            assert map.objects["Parcel2"].values["Weight"] == 2.6, "more than it could carry"
            assert map.has_fact("isOn", ("Parcel2", "Table1"))
            parcel = await harness.operator.observe("Parcel2")
            assert (parcel.support, parcel.held_by) == ("Table1", None)
            assert (parcel.x, parcel.y) == pytest.approx((1.15, 3.7), abs=0.02)

    run(test())


def test_a_robot_demands_that_what_nobody_has_weighed_is_light_enough() -> None:
    async def test() -> None:
        async with simulated(Manipulator, "Robot1", SITE) as harness:
            quoted = await harness.quote("TransferObject", Object="Parcel2", Destination="Scale1")
            assert quoted.condition == "Parcel2.Weight <= Robot1.Payload"
            quoted = await harness.quote("TransferObject", Object="Jar1", Destination="Scale1")
            assert quoted.condition is None, "the map says what it weighs"

    run(test())


@pytest.mark.parametrize(("weight", "known"), [(3.0, 3.0), (7.0, None)])
def test_a_thing_that_is_heavier_than_the_map_says_is_left_where_it_is(weight: float, known: float | None) -> None:
    async def test() -> None:
        async with simulated(Manipulator, "Robot1", SITE) as harness:
            await harness.operator.set_weight("Jar1", weight)
            with pytest.raises(ServiceFailed, match=f"Jar1 weighs {weight:g} kg, which is too heavy for Robot1") as failed:
                await harness.perform("TransferObject", Object="Jar1", Destination="Scale1")
            jar = await harness.operator.observe("Jar1")
            assert (jar.support, jar.held_by) == ("Table1", None)
            assert map_after(failed.value.situation, SITE).has_fact("isOn", ("Jar1", "Table1"))
            assert harness.repository.contents.map.objects["Jar1"].values.get("Weight") == known, "a jar weighs at most 5 kg"
            notes = [advance.note for advance in harness.advances if "cannot be put on the map" in advance.note]
            text = "Jar1 weighs 7 kg, which cannot be put on the map: Jar1: for a Graspable, Weight is at most 5, not 7 [constraint]"
            assert notes == ([] if known is not None else [text])

    run(test())


def test_a_robot_reports_what_a_carried_thing_weighs_if_that_is_news() -> None:
    async def test() -> None:
        async with simulated(Manipulator, "Robot1", SITE) as harness:
            await harness.operator.set_weight("Jar1", 1.2)
            map = await harness.perform("TransferObject", Object="Jar1", Destination="Scale1")
            assert map.has_fact("isOn", ("Jar1", "Scale1"))
            assert harness.repository.contents.map.objects["Jar1"].values["Weight"] == 1.2

    run(test())


def test_only_things_can_be_made_heavier() -> None:
    async def test() -> None:
        async with simulator(text=SITE) as server, OperatorLink(server.host, server.port) as operator:
            with pytest.raises(UsageError, match="Table1 is not a thing"):
                await operator.set_weight("Table1", 2)

    run(test())
