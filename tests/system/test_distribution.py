"""The wheel, in an environment and a folder where there is no checkout: what users have who install the package.

`make distribution` does it with all dependencies installed anew (`WITH_DEPENDENCIES`); otherwise the environment borrows those of the
checkout, but not the package itself.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
import venv
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from somrs.version import __version__
from tests.support.hang import HANG_TIME
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow

SOURCES = ("src", "pyproject.toml", "README.md", "LICENSE")
"""What a distribution is made of."""

ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

WITH_DEPENDENCIES = "WITH_DEPENDENCIES" in os.environ
"""Whether to install the dependencies from the package index, too."""


def run(*arguments: str | Path, cwd: Path) -> str:
    """Run a program, and return its output. A program that fails makes the test fail with what it printed."""
    ended = subprocess.run(
        list(map(str, arguments)), cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True, timeout=HANG_TIME, check=False
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel that was built from the source distribution."""
    folder = tmp_path_factory.mktemp("sources")
    for source in SOURCES:
        if (ROOT / source).is_dir():
            shutil.copytree(ROOT / source, folder / source, ignore=shutil.ignore_patterns("*.egg-info", "__pycache__"))
        else:
            shutil.copy(ROOT / source, folder)
    run(sys.executable, "-m", "build", "--no-isolation", cwd=folder)
    assert (folder / "dist" / f"somrs-{__version__}.tar.gz").exists()
    return folder / "dist" / f"somrs-{__version__}-py3-none-any.whl"


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the programs of an environment where the wheel is installed."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False)
    pip = (sys.executable, "-m", "pip", "--python", folder / "bin" / "python", "install", "--quiet", "--disable-pip-version-check")
    if WITH_DEPENDENCIES:
        run(*pip, "--constraint", ROOT / "constraints.txt", f"{wheel}[simulator,planner,gui]", cwd=folder)
    else:
        run(*pip, "--no-deps", wheel, cwd=folder)
        packages = folder.joinpath("lib", f"python{sys.version_info.major}.{sys.version_info.minor}", "site-packages")
        (packages / "borrowed.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "bin"


@pytest.fixture
def running(environment: Path, tmp_path: Path) -> Iterator[Path]:
    """The folder in which `somrs up` runs the site of the demonstration."""
    output = tmp_path / "up.log"
    with output.open("w") as log:
        program = subprocess.Popen([environment / "somrs", "up", "--speed", "max"], cwd=tmp_path, env=ENVIRONMENT, stdout=log, stderr=log)
    try:
        while "Ctrl-C stops it" not in output.read_text():
            assert program.poll() is None, output.read_text()
            time.sleep(0.1)
        yield tmp_path
    finally:
        program.send_signal(signal.SIGINT)
        assert program.wait(HANG_TIME) in (0, 130), output.read_text()


def test_the_wheel_has_every_file_of_the_package(wheel: Path) -> None:
    files = [path for path in (ROOT / "src" / "somrs").rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    assert {str(path.relative_to(ROOT / "src")) for path in files} - {*zipfile.ZipFile(wheel).namelist()} == set()


def test_the_package_is_the_installed_one(environment: Path, tmp_path: Path) -> None:
    file = run(environment / "python", "-c", "import somrs; print(somrs.__file__)", cwd=tmp_path)
    assert file.startswith(str(environment.parent))
    assert run(environment / "somrs", "--version", cwd=tmp_path).strip() == f"somrs {__version__}"


def test_the_demonstration_runs(environment: Path, tmp_path: Path) -> None:
    output = run(environment / "somrs", "demo", cwd=tmp_path)
    assert "accomplished" in output
    assert (tmp_path / "out" / "scenario-1b" / "messages.svg").exists()


def test_the_examples_run_with_a_system_for_no_particular_site(environment: Path, running: Path) -> None:
    for example in ("ten_line_client.py", "jar_washer.py"):
        shutil.copy(ROOT / "examples" / example, running)
    assert run(environment / "python", "ten_line_client.py", cwd=running).splitlines()[-1].startswith("accomplished")
    washer = subprocess.Popen(
        [environment / "python", "jar_washer.py", "--name", "Washer001"], cwd=running, env=ENVIRONMENT, stdout=subprocess.PIPE
    )
    try:
        assert washer.stdout is not None
        assert json.loads(washer.stdout.readline())["ready"] == "Washer001"
        assert "accomplished" in run(environment / "somrs", "do", "Jar003 wasWashedBy Washer001", cwd=running)
    finally:
        washer.send_signal(signal.SIGTERM)
        assert washer.wait(HANG_TIME) == 0
