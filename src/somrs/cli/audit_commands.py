"""The implementations of `somrs audit`. They work on the data folder, whether its system runs or not."""

from __future__ import annotations

from pathlib import Path

import msgspec

from somrs.access.auditor import actor_text, detail_text
from somrs.access.identity import user_of_process
from somrs.client import terminal
from somrs.errors import UsageError
from somrs.storage.audit_log import Actor, AuditEntry, AuditLog


def _log(data: Path) -> AuditLog:
    if not data.is_dir():
        raise UsageError(f"there is no folder {data}; name the data folder of the system: --data FOLDER")
    return AuditLog(data)


def list_audit(count: int, name: str, data: Path, *, json: bool) -> None:
    log = _log(data)
    entries = [entry for entry in log.entries() if _is_by(entry, name)][-count:] if name else log.latest(count)[::-1]
    if json:
        terminal.print_json(entries)
        return
    if not entries:
        print("no entries" + (f" of {name}" if name else ""))
        return
    rows = (
        (
            entry.number,
            terminal.moment(entry.moment),
            actor_text(entry.actor),
            entry.act,
            entry.outcome,
            detail_text(entry.details),
        )
        for entry in entries
    )
    columns = ("number", "when", "who", "act", "outcome", "details")
    terminal.console().print(terminal.table("Audit log", columns, rows, whole=("number", "when", "act", "outcome")))


def _is_by(entry: AuditEntry, name: str) -> bool:
    return entry.actor is not None and entry.actor.name.casefold() == name.casefold()


def export(file: Path, data: Path) -> None:
    log, count = _log(data), 0
    try:
        with file.open("xb") as output:
            for entry in log.entries():
                output.write(msgspec.json.encode(entry) + b"\n")
                count += 1
    except FileExistsError:
        raise UsageError(f"{file} is there already; name another file") from None
    except OSError as error:
        raise UsageError(f"{file} cannot be written: {error.strerror}; name another file") from None
    print(f"{file}: {count} entries")


def verify(digest: str, data: Path) -> None:
    verified = _log(data).verify(digest or None)
    if not verified.entries:
        print("no entries")
        return
    erased = f"; in {verified.erased} of them something was erased" if verified.erased else ""
    print(f"{verified.entries} entries from number {verified.first} on, none altered{erased}")
    print(f"digest: {verified.digest}")
    print("Note the digest somewhere else. Later, `somrs audit verify --digest DIGEST` shows that nothing up to it was removed.")


def erase(name: str, data: Path) -> None:
    count = _log(data).erase(name, Actor(name=user_of_process()))
    print(f"{name}: erased in {count} entries" if count else f"no entry has the name {name}")
