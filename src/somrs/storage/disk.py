"""A SQLite file with one writer: a thread of its own, which puts all that was asked for since its last commit on disk at once.

Write-ahead log with `synchronous=FULL`: what is `durable` survives a kill and a power cut. One process at a time has the file
open. What is in the file is its owner's, such as a journal with its archive.
"""

from __future__ import annotations

import asyncio
import contextlib
import queue
import sqlite3
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from somrs.errors import UsageError

T = TypeVar("T")

Job = Callable[[sqlite3.Connection], T]
"""Something to be done in the file, by its thread."""

Step = str | Callable[[sqlite3.Connection], None]
"""What makes a file of one version one of the next: statements, or what has them executed. It is within a transaction."""

MOST_JOBS = 2000
"""So many writes go in one transaction at most, so that the first of them does not wait for long."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """A kind of file. `owner`: whose it is (`a Repository's`); `content`: what is in it; `rival`: who else may have it open.

    `application` is SQLite's application_id, by which the file is known; `version` is that of the `tables`. `migrations`: by the version
    of an older file, the step to the next version; a file takes all of its steps, or none. `replaces`: by the application_id of files that
    were used for the same before, the step that makes one of this kind of them. No text in these statements has a semicolon in it.
    """

    owner: str
    content: str
    rival: str
    application: int
    version: int
    tables: str
    migrations: Mapping[int, Step] = field(default_factory=dict)
    replaces: Mapping[int, Step] = field(default_factory=dict)


class Disk:
    """An open file. Its methods raise UsageError for a file that is damaged, is somebody else's, or cannot be written.

    `position` counts the writes that were asked for, `durable` those that are on disk. When one fails, it and all behind it are
    not done, and `failed` says why: the owner is ahead of its disk then, and must not go on.
    """

    def __init__(self, path: Path, kind: Kind) -> None:
        """Open the file, or make it; its folder must be there."""
        if not path.parent.is_dir():
            raise UsageError(f"{path}: there is no folder {path.parent}; make it first")
        self.path, self.kind = path, kind
        self.position = self.durable = 0
        self.failed: UsageError | None = None
        self._batch: list[_Write] = []
        self._jobs: queue.SimpleQueue[list[_Write] | _ImmediateJob | None] = queue.SimpleQueue()
        self._listeners: dict[asyncio.AbstractEventLoop, list[Callable[[], None]]] = {}
        opened: Future[None] = Future()
        self._thread = threading.Thread(target=self._run, args=(opened,), name=f"disk {path.name}", daemon=True)
        self._thread.start()
        opened.result()

    # What others ask for

    def write(self, job: Job[object]) -> int:
        """Have something written, soon, together with what else is asked for. Its position."""
        self.position += 1
        self._batch.append(_Write(job, self.position))
        if len(self._batch) == 1:
            # What one turn of the event loop asks for goes to the thread at once: waking it is what costs.
            try:
                asyncio.get_running_loop().call_soon(self._hand_over)
            except RuntimeError:
                self._hand_over()
        return self.position

    def _hand_over(self) -> None:
        batch, self._batch = self._batch, []
        if batch:
            self._jobs.put(batch)

    def write_and_wait(self, job: Job[T]) -> T:
        """Have something written at once, wholly or not at all, and wait for it: for starts and tools, not for an event loop."""
        return self._enqueue(job, writes=True).result()

    def read(self, job: Job[T]) -> Future[T]:
        """Have something read; all that was asked to be written before is in it."""
        return self._enqueue(job, writes=False)

    def listen(self, listener: Callable[[], None]) -> None:
        """Have the function called in the running event loop whenever `durable` or `failed` changed."""
        self._listeners.setdefault(asyncio.get_running_loop(), []).append(listener)

    def close(self) -> None:
        """Write what is to be written, and close the file."""
        self._hand_over()
        self._jobs.put(None)
        self._thread.join()

    def _enqueue(self, job: Job[T], *, writes: bool) -> Future[T]:
        if not self._thread.is_alive():
            raise UsageError(f"{self.path}: is closed")
        future: Future[T] = Future()
        self._hand_over()
        self._jobs.put(_ImmediateJob(job, future, writes))
        return future

    # The thread

    def _run(self, opened: Future[None]) -> None:
        try:
            db = self._open()
        except BaseException as error:  # noqa: BLE001  # it is raised where the file was to be opened
            opened.set_exception(error)
            return
        opened.set_result(None)
        is_running = True
        while is_running:
            writes, immediate_jobs, is_running = self._collect()
            if writes:
                self._write(db, writes)
            for job in immediate_jobs:
                job.carry_out(self, db)
        db.close()

    def _collect(self) -> tuple[list[_Write], list[_ImmediateJob], bool]:
        """All that is asked for by now; whether there will be more."""
        writes: list[_Write] = []
        immediate_jobs: list[_ImmediateJob] = []
        job = self._jobs.get()
        while job is not None:
            if isinstance(job, list):
                writes += job
            else:
                immediate_jobs.append(job)
            # A read sees what was written before it was asked for, and no harm is done when it sees more.
            if immediate_jobs or len(writes) >= MOST_JOBS:
                return writes, immediate_jobs, True
            try:
                job = self._jobs.get_nowait()
            except queue.Empty:
                return writes, immediate_jobs, True
        return writes, immediate_jobs, False

    def _write(self, db: sqlite3.Connection, writes: list[_Write]) -> None:
        if self.failed is not None:
            return
        try:
            with self.transaction(db):
                for write in writes:
                    write.job(db)
        except UsageError as error:
            self.failed = error
        except BaseException as error:  # noqa: BLE001  # a defect of the owner: it must hear of it, and the thread goes on
            self.failed = UsageError(f"{self.path}: {type(error).__name__}: {error}")
        else:
            self.durable = writes[-1].position
        for loop, listeners in [*self._listeners.items()]:
            with contextlib.suppress(RuntimeError):  # the loop was closed: nobody waits there any more
                loop.call_soon_threadsafe(_notify, listeners)

    def _open(self) -> sqlite3.Connection:
        with self.explained():
            db = sqlite3.connect(self.path, isolation_level=None, timeout=1.0)
        try:
            with self.explained():
                self._prepare(db)
        except BaseException:  # whatever it was, nobody else has the connection to close it
            db.close()
            raise
        return db

    def _prepare(self, db: sqlite3.Connection) -> None:
        kind = self.kind
        (application,) = db.execute("PRAGMA application_id").fetchone()
        (version,) = db.execute("PRAGMA user_version").fetchone()
        (tables,) = db.execute("SELECT count(*) FROM sqlite_schema").fetchone()
        if application == 0 and tables == 0:
            steps: list[Step] = [kind.tables]
        elif application in kind.replaces:
            steps = [kind.replaces[application]]
        elif application != kind.application:
            raise UsageError(f"{self.path}: is a database, but not {kind.owner}; give it a file of its own")
        elif version > kind.version or any(step not in kind.migrations for step in range(version, kind.version)):
            raise UsageError(f"{self.path}: has format {version}, this program reads {kind.version}; run the SO-MRS that wrote it")
        else:
            steps = [kind.migrations[step] for step in range(version, kind.version)]
        # Exclusive: two that write the same file would both be wrong.
        for pragma in ("locking_mode=EXCLUSIVE", "journal_mode=WAL", "synchronous=FULL"):
            db.execute(f"PRAGMA {pragma}")
        with self.transaction(db):  # takes the lock now, not at the first write
            for step in steps:
                execute(db, step)
            if steps:
                execute(db, f"PRAGMA application_id={kind.application}; PRAGMA user_version={kind.version}")

    @contextlib.contextmanager
    def transaction(self, db: sqlite3.Connection) -> Iterator[None]:
        with self.explained():
            db.execute("BEGIN IMMEDIATE")
            try:
                yield
                db.execute("COMMIT")
            except BaseException:  # whatever a job raises: half of a transaction is never kept
                if db.in_transaction:
                    db.execute("ROLLBACK")
                raise

    @contextlib.contextmanager
    def explained(self) -> Iterator[None]:
        """What SQLite says, as something that a person can act on."""
        try:
            yield
        except sqlite3.OperationalError as error:
            if error.sqlite_errorname in ("SQLITE_BUSY", "SQLITE_LOCKED"):
                raise UsageError(f"{self.path}: is in use by {self.kind.rival}; stop that one, or take another file") from None
            raise UsageError(f"{self.path}: cannot be used: {error}; see to the disk's space and the file's rights") from None
        except sqlite3.DatabaseError as error:
            raise UsageError(
                f"{self.path}: is not {self.kind.owner} file, or is damaged ({error}); take another file, or put a copy back"
            ) from None
        except (msgspec.MsgspecError, KeyError) as error:
            raise UsageError(f"{self.path}: holds something that is no {self.kind.content} ({error}); put a copy back") from None


def execute(db: sqlite3.Connection, step: Step) -> None:
    """Execute the statements within the transaction that there is; `executescript` would end it first."""
    if callable(step):
        step(db)
        return
    for statement in step.split(";"):
        db.execute(statement)


def _notify(listeners: list[Callable[[], None]]) -> None:
    for listener in listeners:
        listener()


@dataclass(frozen=True, slots=True)
class _Write:
    job: Job[object]
    position: int


@dataclass(frozen=True, slots=True)
class _ImmediateJob:
    """Something that somebody waits for: a read, or a write in a transaction of its own."""

    job: Job[Any]
    future: Future[Any]
    writes: bool

    def carry_out(self, disk: Disk, db: sqlite3.Connection) -> None:
        try:
            with disk.transaction(db) if self.writes else disk.explained():
                value = self.job(db)
        except BaseException as error:  # noqa: BLE001  # it is raised where the result is waited for
            self.future.set_exception(error)
        else:
            self.future.set_result(value)
