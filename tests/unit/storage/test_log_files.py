"""Logs are bounded, and who follows one misses no line."""

from __future__ import annotations

from pathlib import Path

import pytest

from somrs.client.trace import Follower, Trace
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Header, Message
from somrs.storage.log_files import LogFile, empty_if_full, older_file


def test_a_log_is_never_larger_than_its_limit(tmp_path: Path) -> None:
    log = LogFile(tmp_path / "folder" / "log", 100)
    for number in range(1000):
        log.write_line(b"line %06d" % number)
    log.write_line(b"x" * 1000)
    log.write_line(b"last")
    log.close()
    assert (tmp_path / "folder" / "log").read_bytes() == b"last\n"
    assert len([*(tmp_path / "folder").iterdir()]) == 2


def test_a_log_that_others_write_is_emptied_when_it_is_full(tmp_path: Path) -> None:
    path = tmp_path / "log"
    assert not empty_if_full(path, 100)
    with path.open("ab", buffering=0) as writer:
        writer.write(b"x" * 99)
        assert not empty_if_full(path, 100)
        writer.write(b"y")
        assert empty_if_full(path, 100)
        writer.write(b"z")
    assert path.read_bytes() == b"z"
    assert older_file(path).read_bytes() == b"x" * 99 + b"y"


@pytest.mark.parametrize("pace", [1, 3, 7])
def test_a_follower_reads_on_in_the_file_that_was_moved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pace: int) -> None:
    monkeypatch.setenv("SOMRS_LIMIT_LOG_BYTES", "2500")
    path = tmp_path / "messages.jsonl"
    trace, follower = Trace(path), Follower(path)
    times: list[float] = []
    for number in range(100):
        header = Header(sender="tm", recipient="robot", message_id=f"urn:{number}", transaction="task", participant="Robot1.Work#1")
        trace(Message(header=header, body=frp.Query()), float(number))
        if number % pace == 0:
            times += [line.at for line in follower.new()]
    times += [line.at for line in follower.new()]
    trace.close()
    assert times == [*range(100)]
    assert older_file(path).exists()
