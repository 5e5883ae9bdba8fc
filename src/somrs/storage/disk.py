"""A SQLite file with one writer thread, which commits all writes that were requested since the last commit at once.

The file uses a write-ahead log: a write that is `durable` survives a kill and a power failure. One process at a time has the file open. The
owner, such as a journal with its archive, defines the contents; it may keep them elsewhere first (`store_first`).
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import queue
import sqlite3
import threading
from collections.abc import Awaitable, Callable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from somrs.errors import UsageError
from somrs.storage.high_water import HighWaterMark
from somrs.storage.locking import is_locked

T = TypeVar("T")

Job = Callable[[sqlite3.Connection], T]
"""A read or write of the file, executed by its thread."""

Step = str | Callable[[sqlite3.Connection], None]
"""Converts a file from one version to the next: statements, or a function that executes them. It runs within a transaction."""

WRITE_PAUSE = 0.05
"""Seconds in which writes that are stored elsewhere already are collected for one transaction: nobody waits for it."""

TRY_PAUSE = 1.0
"""Seconds between two attempts to write to a disk that was full."""

LEAST_ROOM = 1_000_000
"""The bytes for which there has to be room on a disk that was full."""

MOST_JOBS = 2000
"""The maximal number of writes in a transaction, so that the first does not wait for long."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """A kind of file. `owner`: whose it is (`a Repository's`); `content`: what it holds; `rival`: who else may have it open.

    `application` is SQLite's application_id, which identifies the kind; `version` is that of the `tables`. `migrations`: by the version of
    an older file, the step to the next version; a file takes all of its steps, or none. `replaces`: by the application_id of an earlier
    kind of file for the same purpose, the step that converts it to this kind. No text in these statements contains a semicolon.
    """

    owner: str
    content: str
    rival: str
    application: int
    version: int
    tables: str
    migrations: Mapping[int, Step] = field(default_factory=dict)
    replaces: Mapping[int, Step] = field(default_factory=dict)


class WriteFailed(UsageError):
    """The file cannot be written now: the disk is full, for example. It may be possible again later."""


class Disk:
    """An open file. Its methods raise UsageError for a file that is damaged, of another kind, or not writable.

    `position` counts the requested writes, `durable` those that are on disk. When a write fails, it and all later ones are not done, and
    `failed` has the reason: the owner is then ahead of its disk and must not continue.
    """

    def __init__(self, path: Path, kind: Kind, *, syncs: bool = True) -> None:
        """Open the file, or create it; its folder must exist. `syncs`: a commit waits until it would survive a power failure. Without, the
        file survives it, but the last commits may be missing: they have to be elsewhere as well."""
        self._synchronous = "FULL" if syncs else "NORMAL"
        if not path.parent.is_dir():
            raise UsageError(f"{path}: there is no folder {path.parent}; make it first")
        self.path, self.kind = path, kind
        self.position = self.durable = 0
        self.failed: UsageError | None = None
        self._batch: list[_Write] = []
        self._jobs: queue.SimpleQueue[list[_Write] | _ImmediateJob | None] = queue.SimpleQueue()
        self._store: Callable[[], Awaitable[None]] | None = None
        self._unstored: list[_Write] = []
        self._stored: list[_Write] = []
        self._storing: asyncio.Task[None] | None = None
        self._listeners: dict[asyncio.AbstractEventLoop, list[Callable[[], None]]] = {}
        self._mark: HighWaterMark | None = HighWaterMark(path)
        self._keeps_mark = syncs
        self._reached: dict[str, int] = {}
        """The numbers of the last entries, with those of the present transaction."""
        opened: Future[None] = Future()
        self._thread = threading.Thread(target=self._run, args=(opened,), name=f"disk {path.name}", daemon=True)
        self._thread.start()
        opened.result()

    # Requests

    def write(self, job: Job[object]) -> int:
        """Request a write, to be committed soon together with others. Return its position."""
        self.position += 1
        self._batch.append(_Write(job, self.position))
        if len(self._batch) == 1:
            # The writes of one turn of the event loop go to the thread together: waking the thread is expensive.
            try:
                asyncio.get_running_loop().call_soon(self._hand_over)
            except RuntimeError:
                self._hand_over()
        return self.position

    def _hand_over(self) -> None:
        batch, self._batch = self._batch, []
        if not batch:
            return
        if self._store is None:
            self._jobs.put(batch)
            return
        self._unstored += batch
        if self._storing is None:
            self._storing = asyncio.create_task(self._store_batches(self._store))

    def store_first(self, store: Callable[[], Awaitable[None]]) -> None:
        """Have `store` keep elsewhere what has been requested to be written, each time before it is written here. It is durable then."""
        self._store = store

    async def stored(self) -> None:
        """Return when all writes requested so far are durable or have failed. Only with `store_first`."""
        last_position = self.position
        self._hand_over()
        while self._storing is not None and self.durable < last_position:
            await asyncio.wait([self._storing])

    async def _store_batches(self, store: Callable[[], Awaitable[None]]) -> None:
        while self._unstored and self.failed is None:
            batch, self._unstored = self._unstored, []
            try:
                await store()
            except UsageError as error:
                self.failed = error
            except Exception as error:  # noqa: BLE001  # a defect of the owner: the owner gets the error
                self.failed = UsageError(f"{self.path}: {type(error).__name__}: {error}")
            else:
                self.durable = batch[-1].position
                self._stored += batch
                if len(self._stored) == len(batch):
                    asyncio.get_running_loop().call_later(WRITE_PAUSE, self._write_stored)
            _notify(self._listeners.get(asyncio.get_running_loop(), []))
        self._storing = None

    def _write_stored(self) -> None:
        batch, self._stored = self._stored, []
        if batch:
            self._jobs.put(batch)

    def write_and_wait(self, job: Job[T]) -> T:
        """Write at once, in a transaction of its own, and wait: for starts and tools, not for an event loop."""
        return self._enqueue(job, writes=True).result()

    async def try_writing(self) -> None:
        """Write to the disk and the file, although a write has failed. Raises WriteFailed when that is not possible."""
        await asyncio.wrap_future(self._enqueue(self._try_writing, writes=True))

    def _try_writing(self, db: sqlite3.Connection) -> None:
        probe = self.path.with_name(self.path.name + "-probe")
        try:
            with probe.open("wb") as file:
                file.write(bytes(LEAST_ROOM))
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise WriteFailed(f"{self.path}: it cannot be written: {error}; check the free disk space") from None
        finally:
            probe.unlink(missing_ok=True)
        db.execute(f"PRAGMA user_version={self.kind.version}")

    def resume(self) -> None:
        """Take writes again after a failed one, which is forgotten with those after it. The owner has to be as the file is."""
        self.failed, self.durable = None, self.position

    def read(self, job: Job[T]) -> Future[T]:
        """Request a read; it includes all writes requested before, and with `store_first` those that are durable."""
        return self._enqueue(job, writes=False)

    def listen(self, listener: Callable[[], None]) -> None:
        """Call the listener in the running event loop whenever `durable` or `failed` changes."""
        self._listeners.setdefault(asyncio.get_running_loop(), []).append(listener)

    def close(self) -> None:
        """Complete the requested writes, with `store_first` those that are durable, and close the file."""
        if self._store is None:
            self._hand_over()
        self._write_stored()
        self._jobs.put(None)
        self._thread.join()

    def _enqueue(self, job: Job[T], *, writes: bool) -> Future[T]:
        if not self._thread.is_alive():
            raise UsageError(f"{self.path}: is closed")
        future: Future[T] = Future()
        self._hand_over()
        self._write_stored()
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
        if self._mark is not None:
            self._mark.close()

    def _collect(self) -> tuple[list[_Write], list[_ImmediateJob], bool]:
        """Return the requested writes and immediate jobs, and whether the thread is to continue."""
        writes: list[_Write] = []
        immediate_jobs: list[_ImmediateJob] = []
        job = self._jobs.get()
        while job is not None:
            if isinstance(job, list):
                writes += job
            else:
                immediate_jobs.append(job)
            # A read has to include the writes requested before it, and may include later ones.
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
        except BaseException as error:  # noqa: BLE001  # a defect of the owner: the owner gets the error, and the thread continues
            self.failed = UsageError(f"{self.path}: {type(error).__name__}: {error}")
        else:
            if self._store is not None:
                return  # nobody has waited for it
            self.durable = writes[-1].position
        for loop, listeners in [*self._listeners.items()]:
            with contextlib.suppress(RuntimeError):  # the loop was closed: no listener waits there any more
                loop.call_soon_threadsafe(_notify, listeners)

    # The numbers of entries

    def reach(self, component: str, number: int) -> None:
        """Note within a write that the file has the component's entries up to this number."""
        self._reached[component] = number

    def begin_at(self, component: str, number: int) -> None:
        """Note within a write that the component's entries begin anew after this number."""
        if self._mark is not None:
            self._mark.write({name: reached for name, reached in self._mark.numbers.items() if name != component})
        self._reached[component] = number

    def check_reached(self, component: str, number: int) -> None:
        """Raise UsageError if the file has had more entries of the component than up to this number."""
        reached = self._reached.get(component, 0)
        if self._mark is not None and reached > number:
            raise UsageError(
                f"{self.path}: the last {reached - number} of {reached} inputs are missing; the file or its -wal was damaged or removed. "
                f"Restore a backup; or delete {self._mark.path} to go on without them: what came after is forgotten"
            )
        if self._mark is not None and not self._keeps_mark:
            # What is elsewhere as well is not counted here: later, the mark would be that of other entries.
            self._mark.path.unlink(missing_ok=True)
            self._mark = None

    def _open(self) -> sqlite3.Connection:
        if self._mark is not None:
            self._mark.open()
            self._reached = dict(self._mark.numbers)
        with self.explained():
            db = sqlite3.connect(self.path, isolation_level=None, timeout=1.0)
        try:
            with self.explained():
                self._prepare(db)
        except BaseException:  # whatever the error is, only this function can close the connection
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
            raise UsageError(f"{self.path}: is a database, but not {kind.owner}; use another file")
        elif version > kind.version or any(step not in kind.migrations for step in range(version, kind.version)):
            raise UsageError(f"{self.path}: has format {version}, this program reads {kind.version}; use the SO-MRS that wrote it")
        else:
            steps = [kind.migrations[step] for step in range(version, kind.version)]
        # Exclusive: two processes that write the same file would corrupt each other's state.
        for pragma in ("locking_mode=EXCLUSIVE", "journal_mode=WAL", f"synchronous={self._synchronous}"):
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
                if self._mark is not None:
                    self._reached = dict(self._mark.numbers)
                if db.in_transaction:
                    db.execute("ROLLBACK")
                raise
            if self._mark is not None and self._reached != self._mark.numbers:
                self._mark.write(dict(self._reached))

    @contextlib.contextmanager
    def explained(self) -> Iterator[None]:
        """Convert errors of SQLite to errors on which a person can act."""
        try:
            yield
        except sqlite3.OperationalError as error:
            if is_locked(error):
                raise UsageError(f"{self.path}: is in use by {self.kind.rival}; stop it, or use another file") from None
            raise WriteFailed(f"{self.path}: cannot be used: {error}; check the free disk space and the file's permissions") from None
        except sqlite3.Error as error:
            raise UsageError(
                f"{self.path}: is not {self.kind.owner} file, or is damaged ({error}); use another file, or restore a backup"
            ) from None
        except (ValueError, TypeError, LookupError) as error:  # data that were altered may raise any of these
            raise UsageError(f"{self.path}: holds something that is no {self.kind.content} ({error}); restore a backup") from None


def execute(db: sqlite3.Connection, step: Step) -> None:
    """Execute the statements within the present transaction, which `executescript` would end."""
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
    """A job for whose result a caller waits: a read, or a write in a transaction of its own."""

    job: Job[Any]
    future: Future[Any]
    writes: bool

    def carry_out(self, disk: Disk, db: sqlite3.Connection) -> None:
        if not self.future.set_running_or_notify_cancel():  # from here on, it cannot be cancelled
            return
        try:
            with disk.transaction(db) if self.writes else disk.explained():
                value = self.job(db)
        except BaseException as error:  # noqa: BLE001  # it is raised where the result is waited for
            self.future.set_exception(error)
        else:
            self.future.set_result(value)
