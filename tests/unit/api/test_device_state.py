"""The state of a device: what decides it, and the same label everywhere."""

from __future__ import annotations

import re

import pytest

from somrs.api.device_state import FAULT_LABELS, LABELS, DeviceState, is_working, state_of
from somrs.client.state_labels import OUTCOMES, PHASES
from somrs.devices.simulator.link.commands import Fault
from somrs.gui import icons
from somrs.gui.components import scene
from somrs.gui.device_card import SIGNS
from somrs.gui.pages import task_text
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.task_views import Phase


def test_a_robot_with_a_broken_drive_is_not_working_while_it_is_idle() -> None:
    working = is_working(on_map=True, faults=(Fault.DRIVE,))
    assert state_of(on_map=True, offers=True, working=working, busy=False, booked=False) is DeviceState.NOT_WORKING


def test_a_robot_is_ready_as_soon_as_it_is_mended_whatever_the_map_still_says() -> None:
    working = is_working(on_map=False, faults=())
    assert state_of(on_map=True, offers=True, working=working, busy=False, booked=False) is DeviceState.READY


@pytest.mark.parametrize("on_map", [True, False])
def test_of_a_device_that_is_not_simulated_the_map_says_whether_it_works(on_map: bool) -> None:
    assert is_working(on_map, None) is on_map


@pytest.mark.parametrize(
    ("on_map", "offers", "busy", "booked", "state"),
    [
        (True, True, True, True, DeviceState.BUSY),
        (True, True, False, True, DeviceState.BOOKED),
        (True, True, False, False, DeviceState.READY),
        (True, False, False, False, DeviceState.NOTHING_ON_OFFER),
        (False, True, False, False, DeviceState.READY),
        (False, False, False, False, DeviceState.DEPARTED),
    ],
)
def test_the_state_of_a_device_that_works(on_map: bool, offers: bool, busy: bool, booked: bool, state: DeviceState) -> None:
    assert state_of(on_map=on_map, offers=offers, working=True, busy=busy, booked=booked) is state


def test_who_left_is_gone_and_not_broken() -> None:
    assert state_of(on_map=False, offers=False, working=False, busy=False, booked=False) is DeviceState.DEPARTED


def test_every_state_has_a_label_and_a_sign() -> None:
    assert set(LABELS) == set(SIGNS) == set(DeviceState)
    assert set(PHASES) == set(task_text.PHASES) == set(Phase)
    assert set(OUTCOMES) == set(icons.OUTCOMES) == set(Outcome)


def test_the_scene_calls_faults_as_everybody_does() -> None:
    text = (scene.MODULES / "labels.js").read_text()
    line = re.search(r"const FAULTS = \{(.*)\}", text)
    assert line is not None
    assert dict(re.findall(r'(\w+): "([^"]*)"', line[1])) == {fault.value: label for fault, label in FAULT_LABELS.items()}
