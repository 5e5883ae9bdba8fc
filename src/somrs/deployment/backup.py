"""Backups of a system's data folder, and their restoration.

All files are copied as they are at one moment, at which the programs of a running system stand still. That is what they would be if all
programs were killed at that moment, and a system continues from such files. A backup is a compressed tar archive with a manifest.
"""

from __future__ import annotations

import asyncio
import hashlib
import io
import os
import shutil
import signal
import tarfile
import zlib
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path, PurePosixPath

import msgspec

from somrs.access.store import LOCAL_FILE
from somrs.atomic_files import write_atomically
from somrs.client.addresses import SYSTEM_FILE, Addresses
from somrs.deployment.incidents import FILE as INCIDENTS_FILE
from somrs.deployment.private_files import make_private
from somrs.deployment.program import Program
from somrs.deployment.watchdog import is_stopped
from somrs.errors import UsageError
from somrs.storage.locking import is_in_use
from somrs.version import __version__

MANIFEST = "somrs-backup.json"
REQUEST, ANSWER, COPY = "backup-request.json", "backup-answer.json", "backup-copy"
"""In the data folder: what is asked of the running system, what it answers, and its copy of the files."""

LEFT_OUT = ("logs", COPY, REQUEST, ANSWER, SYSTEM_FILE, LOCAL_FILE, INCIDENTS_FILE)
"""What a backup leaves out of the data folder: it belongs to a run."""

_LEFT_OUT_ENDINGS = ("-shm", "-mark", "-probe", ".copy", ".new")

POLL_PAUSE = 0.1
"""Seconds between two looks for the request, or for its answer."""


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """What a backup has: its files with their SHA-256 sums. `program`: who made it."""

    program: str
    files: dict[str, str]


class Request(msgspec.Struct, frozen=True, kw_only=True):
    """A backup into this file is asked for."""

    target: str


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """The backup is done, or why it is not. `target`: that of the request."""

    target: str
    problem: str = ""


async def back_up(data: Path, target: Path) -> None:
    """Make a backup of a data folder, whose system may run. Raises UsageError if that is not possible."""
    target = target.resolve()
    if target.exists():
        raise UsageError(f"{target}: is there already; give the backup another name")
    if not target.parent.is_dir():
        raise UsageError(f"{target}: there is no folder {target.parent}; make it first")
    if not (data / "repository.sqlite").exists():
        raise UsageError(f"{data}: there is no system in this folder; select another with `--data`")
    if not is_in_use(data / "repository.sqlite"):
        _write_backup(data, target)
        return
    if Addresses.read(data).bus is not None:
        raise UsageError(f"{data}: its system is on a bus, where each journal has copies; stop the system, and make the backup then")
    (data / ANSWER).unlink(missing_ok=True)
    write_atomically(data / REQUEST, msgspec.json.encode(Request(target=str(target))))
    try:
        while (answer := _read_answer(data)) is None or answer.target != str(target):
            await asyncio.sleep(POLL_PAUSE)
            if not is_in_use(data / "repository.sqlite") and not (data / COPY).exists():
                raise UsageError(f"{data}: its system has ended; try again")
    finally:
        (data / REQUEST).unlink(missing_ok=True)
    if answer.problem:
        raise UsageError(answer.problem)


async def serve_request(data: Path, programs: Sequence[Program]) -> None:
    """Make the backup that is asked for, if there is one: in the process that runs the programs."""
    try:
        request = msgspec.json.decode((data / REQUEST).read_bytes(), type=Request)
    except (OSError, msgspec.MsgspecError):
        return
    problem = ""
    try:
        await _copy_at_one_moment(data, programs)
        await asyncio.to_thread(_write_backup, data / COPY, Path(request.target))
    except (OSError, UsageError) as error:
        problem = f"the backup failed: {error}"
    finally:
        shutil.rmtree(data / COPY, ignore_errors=True)
        (data / REQUEST).unlink(missing_ok=True)
    write_atomically(data / ANSWER, msgspec.json.encode(Answer(target=request.target, problem=problem)))


async def _copy_at_one_moment(data: Path, programs: Sequence[Program]) -> None:
    """Copy the files while the programs stand still."""
    running = [program.process for program in programs if program.process.returncode is None]
    try:
        for process in running:
            with suppress(ProcessLookupError):
                process.send_signal(signal.SIGSTOP)
        while not all(process.returncode is not None or is_stopped(process.pid) for process in running):
            await asyncio.sleep(0.001)
        shutil.rmtree(data / COPY, ignore_errors=True)
        for file in _files(data):
            copy = data / COPY / file.relative_to(data)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)
    finally:
        for process in running:
            with suppress(ProcessLookupError):
                process.send_signal(signal.SIGCONT)


def _files(data: Path) -> list[Path]:
    files = (path for path in sorted(data.rglob("*")) if path.is_file() and not path.is_symlink())
    return [path for path in files if path.relative_to(data).parts[0] not in LEFT_OUT and not path.name.endswith(_LEFT_OUT_ENDINGS)]


def _write_backup(folder: Path, target: Path) -> None:
    """Write the archive. A backup that is not complete never has its name."""
    part = target.with_name(target.name + ".part")
    files = {str(PurePosixPath(file.relative_to(folder))): file for file in _files(folder)}
    sums = {name: hashlib.sha256(file.read_bytes()).hexdigest() for name, file in files.items()}
    manifest = msgspec.json.encode(Manifest(program=f"SO-MRS {__version__}", files=sums))
    try:
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as stream:
            with tarfile.open(fileobj=stream, mode="w:gz") as archive:
                entry = tarfile.TarInfo(MANIFEST)
                entry.size = len(manifest)
                archive.addfile(entry, io.BytesIO(manifest))
                for name, file in files.items():
                    archive.add(file, name, recursive=False)
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(target)
    finally:
        part.unlink(missing_ok=True)


def restore(backup: Path, data: Path) -> Manifest:
    """Make a data folder from a backup. Raises UsageError if the folder has something, or the backup is none or is damaged."""
    if data.exists() and any(data.iterdir()):
        raise UsageError(f"{data}: is not empty; restore into another folder with `--data`, or move this one away")
    new_folder = data.with_name(data.name + ".restoring")
    shutil.rmtree(new_folder, ignore_errors=True)
    try:
        make_private(new_folder)
        manifest = _unpack(backup, new_folder)
        if data.exists():
            data.rmdir()
        new_folder.rename(data)
    except (OSError, EOFError, tarfile.TarError, msgspec.MsgspecError, zlib.error) as error:
        raise UsageError(f"{backup}: is no backup, or is damaged ({error}); use another one") from None
    finally:
        shutil.rmtree(new_folder, ignore_errors=True)
    return manifest


def _unpack(backup: Path, folder: Path) -> Manifest:
    with tarfile.open(backup, "r:gz") as archive:
        first = archive.next()
        if first is None or first.name != MANIFEST:
            raise tarfile.TarError(f"it does not begin with {MANIFEST}")
        manifest = msgspec.json.decode(_content(archive, first), type=Manifest)
        missing = set(manifest.files)
        for entry in archive:
            if entry.name == MANIFEST:
                continue
            content = _content(archive, entry)
            if hashlib.sha256(content).hexdigest() != manifest.files.get(entry.name) or not _is_inside(entry.name):
                raise tarfile.TarError(f"{entry.name} is not what was stored")
            file = folder / entry.name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.touch(mode=0o600)
            file.write_bytes(content)
            missing.discard(entry.name)
    if missing:
        raise tarfile.TarError(f"{', '.join(sorted(missing))} is missing")
    return manifest


def _is_inside(name: str) -> bool:
    path = PurePosixPath(name)
    return not path.is_absolute() and ".." not in path.parts


def _content(archive: tarfile.TarFile, entry: tarfile.TarInfo) -> bytes:
    stream = archive.extractfile(entry) if entry.isfile() else None
    if stream is None:
        raise tarfile.TarError(f"{entry.name} is no file")
    return stream.read()


def _read_answer(data: Path) -> Answer | None:
    try:
        return msgspec.json.decode((data / ANSWER).read_bytes(), type=Answer)
    except (OSError, msgspec.MsgspecError):
        return None
