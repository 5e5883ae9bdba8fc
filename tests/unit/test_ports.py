"""Ports are reserved for programs that are still to be started, and for nobody else."""

from __future__ import annotations

import socket
import subprocess
import sys

import pytest

from somrs.errors import UsageError
from somrs.ports import Reservation, check_address, listen_at

HOST = "127.0.0.1"
LISTEN = "import sys; from somrs.ports import listen_at; s = listen_at('127.0.0.1', int(sys.argv[1])); print('here', flush=True); input()"


def connects(port: int) -> bool:
    with socket.socket() as sock:
        return sock.connect_ex((HOST, port)) == 0


def test_who_reserved_it_listens_there_again_and_again() -> None:
    with Reservation(HOST, 1) as reserved:
        (port,) = reserved.ports
        for _ in range(3):
            assert not connects(port)
            with listen_at(HOST, port):
                assert connects(port)


def test_a_program_that_it_started_listens_there_and_another_does_not() -> None:
    with Reservation(HOST, 2) as reserved:
        line = [sys.executable, "-c", LISTEN, str(reserved.ports[1])]
        stranger = subprocess.run(line, capture_output=True, text=True, input="\n")
        assert "cannot listen" in stranger.stderr
        with subprocess.Popen(line, env=reserved.environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "here\n"
            assert connects(reserved.ports[1])
            process.communicate("\n")


def test_nobody_is_given_a_reserved_port_by_chance() -> None:
    with Reservation(HOST, 500) as first, Reservation(HOST, 500) as second:
        assert not {*first.ports} & {*second.ports}


def test_a_port_is_had_again_unless_somebody_else_has_it_now() -> None:
    with Reservation(HOST, 2) as earlier_reservation:
        ports = earlier_reservation.ports
    with listen_at(HOST, ports[0]), Reservation(HOST, 3, ports) as now:
        assert now.ports[0] != ports[0]
        assert now.ports[1] == ports[1]
        assert len({*now.ports}) == 3
        with Reservation(HOST, 1, now.ports[2:]) as other_reservation:
            assert other_reservation.ports != now.ports[2:]


@pytest.mark.parametrize("is_reserved", [True, False])
def test_connections_that_linger_do_not_keep_it(is_reserved: bool) -> None:
    with Reservation(HOST, 1) as earlier_reservation:
        if not is_reserved:
            earlier_reservation.close()
        with (
            listen_at(HOST, earlier_reservation.ports[0]) as listener,
            socket.create_connection((HOST, earlier_reservation.ports[0])),
            listener.accept()[0],
        ):  # the server hangs up first: its end lingers
            pass
    with Reservation(HOST, 1, earlier_reservation.ports) as now:
        assert now.ports == earlier_reservation.ports
        listen_at(HOST, now.ports[0]).close()


def test_when_it_is_over_the_port_is_like_any_other() -> None:
    with Reservation(HOST, 1) as reserved:
        (port,) = reserved.ports
    with listen_at(HOST, port), pytest.raises(UsageError, match=f"cannot listen at {HOST}:{port}.*another --port"):
        listen_at(HOST, port)


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_where_nobody_can_be_reached_is_no_address(host: str) -> None:
    with pytest.raises(UsageError, match="is no address at which other programs reach this computer: name the one"):
        check_address(host)
    for address in ("127.0.0.1", "10.0.0.7", "robot7.example", "::1"):
        check_address(address)
