"""Ports are reserved for programs that are still to be started, and for nobody else."""

from __future__ import annotations

import socket
import subprocess
import sys

import pytest

from somrs.errors import UsageError
from somrs.ports import Reservation, bound

HERE = "127.0.0.1"
LISTEN = (
    "import sys; from somrs.ports import bound; s = bound('127.0.0.1', int(sys.argv[1])); s.listen(); print('here', flush=True); input()"
)


def connects(port: int) -> bool:
    with socket.socket() as one:
        return one.connect_ex((HERE, port)) == 0


def test_who_reserved_it_listens_there_again_and_again() -> None:
    with Reservation(HERE, 1) as reserved:
        (port,) = reserved.ports
        for _ in range(3):
            assert not connects(port)
            with bound(HERE, port) as one:
                one.listen()
                assert connects(port)


def test_a_program_that_it_started_listens_there_and_another_does_not() -> None:
    with Reservation(HERE, 2) as reserved:
        line = [sys.executable, "-c", LISTEN, str(reserved.ports[1])]
        stranger = subprocess.run(line, capture_output=True, text=True, input="\n")
        assert "cannot listen" in stranger.stderr
        with subprocess.Popen(line, env=reserved.environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as own:
            assert own.stdout is not None
            assert own.stdout.readline() == "here\n"
            assert connects(reserved.ports[1])
            own.communicate("\n")


def test_nobody_is_given_a_reserved_port_by_chance() -> None:
    with Reservation(HERE, 500) as first, Reservation(HERE, 500) as second:
        assert not {*first.ports} & {*second.ports}


def test_a_port_is_had_again_unless_somebody_else_has_it_now() -> None:
    with Reservation(HERE, 2) as before:
        wanted = before.ports
    with bound(HERE, wanted[0]) as taken:
        taken.listen()
        with Reservation(HERE, 3, wanted) as now:
            assert now.ports[0] != wanted[0]
            assert now.ports[1] == wanted[1]
            assert len({*now.ports}) == 3
            with Reservation(HERE, 1, now.ports[2:]) as other:
                assert other.ports != now.ports[2:]


@pytest.mark.parametrize("is_reserved", [True, False])
def test_connections_that_linger_do_not_keep_it(is_reserved: bool) -> None:
    with Reservation(HERE, 1) as before:
        if not is_reserved:
            before.close()
        with bound(HERE, before.ports[0]) as one:
            one.listen()
            with socket.create_connection((HERE, before.ports[0])), one.accept()[0]:  # the server hangs up first: its end lingers
                pass
    with Reservation(HERE, 1, before.ports) as now:
        assert now.ports == before.ports
        bound(HERE, now.ports[0]).close()


def test_when_it_is_over_the_port_is_like_any_other() -> None:
    with Reservation(HERE, 1) as reserved:
        (port,) = reserved.ports
    with bound(HERE, port) as one:
        one.listen()
        with pytest.raises(UsageError, match=f"cannot listen at {HERE}:{port}.*another --port"):
            bound(HERE, port)
