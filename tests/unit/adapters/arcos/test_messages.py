"""What ARCOS robots are told and report, byte by byte."""

from __future__ import annotations

import struct

from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.arcos.messages import (
    Command,
    Configuration,
    Flag,
    GripperReport,
    GripperState,
    Status,
    command,
    report,
    sync_reply,
)

SIP = bytes.fromhex("33 e803 0c fe 0002 6400 9cff 7d 0106 0000 0100 00 02 03 2c01 04 dc05 05 00 00 0c 00 7d00 00")
"""A robot that drives, with its right bumpers at something, and something between the paddles."""


def test_a_status() -> None:
    status = report(SIP)
    assert isinstance(status, Status)
    assert (status.is_moving, status.x, status.y, status.heading) == (True, 1000, 0xFE0C, 512)
    assert (status.left_speed, status.right_speed, status.battery) == (100, -100, 125)
    assert (status.stalled_wheels, status.bumpers) == (("left",), ("front",))
    assert status.flags == Flag.MOTORS
    assert status.sonar == ((3, 300), (4, 1500))
    assert status.gripper == GripperState.OPEN | GripperState.MOVING
    assert (status.inputs, status.charge_state) == (0x0C, 0)


def test_a_status_of_an_older_robot_ends_with_its_sonar() -> None:
    status = report(SIP[:28])
    assert isinstance(status, Status)
    assert (status.battery, status.gripper, status.charge_state) == (125, 0, None)


@given(st.binary(min_size=1, max_size=60))
def test_no_report_is_too_odd_to_be_read(body: bytes) -> None:
    report(body)
    sync_reply(body)


@given(st.integers(0, len(SIP)))
def test_a_status_that_is_cut_off_is_none_or_one(length: int) -> None:
    assert isinstance(report(SIP[: max(1, length)]), Status | None)


def test_the_identity_comes_with_the_last_synchronization_packet() -> None:
    reply = sync_reply(b"\x02Anna\0Pioneer\0p3dx-sh\0")
    assert reply is not None
    assert reply.identity == ("Anna", "Pioneer", "p3dx-sh")
    assert sync_reply(b"\x32") is None


def test_reports_of_the_gripper_and_the_configuration() -> None:
    assert report(b"\xe0\x01\x22\x0a") == GripperReport(kind=1, state=0x22, grasp_time=10)
    tops = struct.pack("<BHHHHH", 0, 300, 750, 300, 2000, 500)
    equipment = b"Anna\0" + struct.pack("<BBBHHBHHH", 100, 0, 0, 1, 1, 1, 110, 16570, 2000)
    configuration = report(b"\x20Pioneer\0p3dx-sh\0A1\0" + tops + equipment + b"more")
    assert configuration == Configuration(
        kind="Pioneer", subkind="p3dx-sh", serial_number="A1", top_turning=300, top_speed=750, watchdog=2000
    )
    shorter = report(b"\x20Pioneer\0p3dx-sh\0A1\0" + tops)
    assert isinstance(shorter, Configuration)
    assert shorter.watchdog is None


def test_arguments_have_their_sign_in_their_type() -> None:
    assert command(Command.VEL, 300) == bytes.fromhex("fafb060b3b2c01373c")
    assert command(Command.VEL, -300)[3:7] == bytes.fromhex("0b1b2c01")
    assert command(Command.VEL, 10**6)[3:7] == bytes.fromhex("0b3bff7f")
    assert command(Command.STOP) == bytes.fromhex("fafb031d001d")
