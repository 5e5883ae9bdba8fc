"""Records which tests reach which lines, and the duration of each test, once for each version of the code and of each test file."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable
from pathlib import Path

import msgspec
from coverage import CoverageData

from somrs.errors import SomrsError
from verification.mutants.mutations import Mutant
from verification.mutants.runner import RunRequest
from verification.mutants.runner_process import Runner
from verification.mutants.tree import Tree, digest

TESTED_BY = ("tests/unit", "tests/integration")


class Recorded(msgspec.Struct):
    """The record of a test file."""

    digest: str
    tests: dict[str, float]
    """The tests, with their durations in seconds."""


class Record:
    """The record of the code in a tree. It is stored in a folder, so that it can be used again."""

    def __init__(self, root: Path, folder: Path) -> None:
        self._root = root
        code = [*_python(root / "src"), *_python(root / "tests" / "support"), *root.glob("tests/conftest.py"), root / "pyproject.toml"]
        self.version = digest([*code, *(root / name for name in self._test_files())])
        """The digest of the code, and of the tests that are run on mutants."""
        self._folder = folder / digest(code)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._importers = _importers(root)
        self._files: dict[str, Recorded] = {}
        self._read()

    @property
    def modules(self) -> Path:
        """The file with the modules to load before the project; it exists after a recording."""
        return self._folder / "modules"

    @property
    def stale(self) -> tuple[str, ...]:
        """The test files without a record of their current version."""
        return tuple(name for name, now in self._test_files().items() if self._files.get(name, UNRECORDED).digest != now)

    def renew(self, tree: Tree, on_test: Callable[[], None]) -> None:
        """Record the stale test files."""
        stale, now = self.stale, self._test_files()
        recorded = {name: Recorded(now[name], {}) for name in stale}
        failed: list[str] = []
        log = self._folder / "log"
        with Runner(tree, None) as runner:
            for event in runner.play(RunRequest(files=stale, record=str(self._lines), log=str(log))):
                if event.modules:
                    self.modules.write_text("\n".join(event.modules))
                elif event.outcome == "failed":
                    failed.append(event.test)
                elif event.test:
                    if event.outcome == "passed":
                        recorded[event.test.partition("::")[0]].tests[event.test] = event.seconds
                    on_test()
                elif event.status != 0:
                    raise SomrsError(f"tests fail without a change, see {log}: {', '.join(failed) or 'all'}")
        self._files = {name: entry for name, entry in self._files.items() if name in now} | recorded
        (self._folder / "tests.json").write_bytes(msgspec.json.encode(self._files))
        self._read()

    def tests_reaching(self, mutant: Mutant) -> dict[str, float]:
        """Return the tests that reach the change, the fastest first, with their durations in seconds.

        For programs that a test starts, only the called functions are known.

        For code that runs when a module is imported, these are the tests that reach a function of the module, followed by those that import
        it, or reach a module that does. A function may be called both ways: the tests that reach its lines come first.
        """
        reaching: dict[str, float] = {}
        if mutant.line_range is not None:
            lines = range(mutant.line_range[0], mutant.line_range[1] + 1)
            reaching = self._fastest_first(self._reaching(mutant.file, lines))
            if self._at_import[mutant.file].isdisjoint(lines):
                return reaching
        module_tests = self._fastest_first(self._reaching(mutant.file))
        importer_tests = {test for file in self._importers.get(mutant.file, ()) for test in (*self._tests_in(file), *self._reaching(file))}
        return reaching | module_tests | self._fastest_first(importer_tests - {*module_tests})

    def count(self) -> int:
        return len(self._seconds)

    @property
    def _lines(self) -> Path:
        return self._folder / "lines.coverage"

    def _read(self) -> None:
        place = self._folder / "tests.json"
        self._files = msgspec.json.decode(place.read_bytes(), type=dict[str, Recorded]) if place.exists() else {}
        self._seconds = {test: seconds for file in self._files.values() for test, seconds in file.tests.items()}
        self._data = CoverageData(str(self._lines))
        self._data.read()
        self._measured: dict[str, list[str]] = {}
        for name in self._data.measured_files():
            self._measured.setdefault(f"src/somrs/{name.rpartition('/src/somrs/')[2]}", []).append(name)
        self._reached: dict[str, dict[int, set[str]]] = {}
        self._at_import: dict[str, set[int]] = {}
        self._calls: dict[str, set[tuple[str, int, int]]] = {}
        calls = self._lines.with_suffix(".calls")
        for line in calls.read_text(encoding="utf-8").splitlines() if calls.exists() else ():
            test, file, first, last_line = line.split("\t")
            if test in self._seconds:
                self._calls.setdefault(f"src/{file}", set()).add((test, int(first), int(last_line)))

    def _test_files(self) -> dict[str, str]:
        files = sorted(file for folder in TESTED_BY for file in (self._root / folder).rglob("test_*.py"))
        return {file.relative_to(self._root).as_posix(): digest([file]) for file in files}

    def _reaching(self, file: str, lines: range | None = None) -> set[str]:
        if file not in self._reached:
            reached: dict[int, set[str]] = {}
            at_import = self._at_import.setdefault(file, set())
            for name in self._measured.get(file, ()):
                for line, tests in self._data.contexts_by_lineno(name).items():
                    reached.setdefault(line, set()).update(test for test in tests if test in self._seconds)
                    if "" in tests:
                        at_import.add(line)
            self._reached[file] = reached
        reaching = set().union(*(tests for line, tests in self._reached[file].items() if lines is None or line in lines))
        return reaching | {test for test, first, last_line in self._calls.get(file, ()) if lines is None or first <= lines[0] <= last_line}

    def _tests_in(self, file: str) -> Iterable[str]:
        return self._files[file].tests if file in self._files else ()

    def _fastest_first(self, tests: set[str]) -> dict[str, float]:
        return {test: self._seconds[test] for test in sorted(tests, key=lambda test: (self._seconds[test], test))}


UNRECORDED = Recorded("", {})


def _python(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.py"))


def _importers(root: Path) -> dict[str, set[str]]:
    """Return, for the file of each module, the files of the modules and tests that import it, also through its package.

    A file that uses `pkgutil` imports all modules.
    """
    files = {file.relative_to(root).as_posix() for file in _python(root / "src" / "somrs")}
    tests = {file.relative_to(root).as_posix() for folder in TESTED_BY for file in _python(root / folder)}
    importers_of: dict[str, set[str]] = {}
    for file in files | tests:
        for node in ast.walk(ast.parse((root / file).read_bytes())):
            if isinstance(node, ast.Import) and "pkgutil" in [alias.name for alias in node.names]:
                for name in files:
                    importers_of.setdefault(name, set()).add(file)
            elif isinstance(node, ast.ImportFrom) and node.module:
                base = "src/" + node.module.replace(".", "/")
                for name in (f"{base}.py", f"{base}/__init__.py", *(f"{base}/{alias.name}.py" for alias in node.names)):
                    if name in files:
                        importers_of.setdefault(name, set()).add(file)
    for name, importers in importers_of.items():
        for package in [importer for importer in importers if importer.endswith("/__init__.py") and importer != name]:
            importers |= importers_of.get(package, set())
    return importers_of
