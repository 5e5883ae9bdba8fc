"""Real browsers at real systems: Debian's Chromium, driven by Playwright, at the processes that `somrs up` starts."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from somrs.client.client import Addresses
from somrs.errors import UsageError
from tests.support.paths import ROOT, SCENARIO_1

playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright  # noqa: E402  # behind the skip

CHROMIUM = Path("/usr/bin/chromium")
FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-gpu-compositing",  # pages are drawn without GL, which is all software here; only the 3D view takes it
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
SCREENSHOTS = ROOT / "out" / "screenshots"
WIDTHS = {"1280": (1280, 800), "1920": (1920, 1080), "820": (820, 1180)}
UP_TIME = 90.0


class Running:
    """A system that `somrs up` runs, with its windows."""

    def __init__(self, data: Path, site: Path = SCENARIO_1, speed: str = "4") -> None:
        line = [sys.executable, "-m", "somrs.cli.main", "up", str(site), "--data", str(data), "--speed", speed]
        self.data = data
        self._said = (data.parent / f"{data.name}.log").open("wb")
        self._process = subprocess.Popen(line, stdout=self._said, stderr=self._said, start_new_session=True)
        self.addresses = self._addresses()

    @property
    def url(self) -> str:
        assert self.addresses.gui is not None
        return self.addresses.gui

    def _addresses(self) -> Addresses:
        until = time.monotonic() + UP_TIME
        while time.monotonic() < until and self._process.poll() is None:
            try:
                found = Addresses.read(self.data)
            except UsageError:
                pass
            else:
                if found.gui is not None and b"In the browser" in Path(self._said.name).read_bytes():
                    return found
            time.sleep(0.2)
        self.stop()
        raise AssertionError(f"the system did not start: {Path(self._said.name).read_text(errors='replace')}")

    def kill(self, program: str) -> None:
        """SIGKILL one of its programs, such as `gui`; it is started again by itself."""
        found = subprocess.run(["pgrep", "-f", f"run {program} .*--data {self.data}"], capture_output=True, text=True, check=True)
        for id in found.stdout.split():
            os.kill(int(id), signal.SIGKILL)

    @contextmanager
    def without(self, program: str) -> Iterator[None]:
        """One of its programs is killed, and not started again before the end."""
        self._process.send_signal(signal.SIGSTOP)
        try:
            self.kill(program)
            yield
        finally:
            self._process.send_signal(signal.SIGCONT)

    def stop(self) -> None:
        self._process.send_signal(signal.SIGINT)
        self._process.wait(30)
        self._said.close()


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """The paper's scenario, for all tests of one file."""
    running = Running(tmp_path_factory.mktemp("browser") / "data")
    yield running
    running.stop()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    if not CHROMIUM.exists():
        pytest.skip("there is no Chromium; on Debian and Ubuntu: sudo apt-get install chromium")
    expect.set_options(timeout=15_000)  # on a machine that does much else, too
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=str(CHROMIUM), args=[*FLAGS])
        yield browser
        browser.close()


class Outside(AssertionError):
    """A page asked for something from another machine."""


@pytest.fixture
def window(browser: Browser) -> Iterator[Callable[..., Page]]:
    """Opens a page in a browser profile of its own: `window(url, size="1280", dark=False)`. Whatever a page writes to the console as an
    error, and every request that would leave the machine, fails the test at its end."""
    contexts: list[BrowserContext] = []
    errors: list[str] = []

    def opened(url: str, size: str = "1280", *, dark: bool = False) -> Page:
        width, height = WIDTHS[size]
        context = browser.new_context(viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light")
        context.set_default_timeout(15_000)
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda said: errors.append(said.text) if said.type == "error" and "ERR_CONNECTION" not in said.text else None)
        page.on("request", lambda asked: None if _local(asked.url) else errors.append(f"asked for {asked.url}"))
        page.goto(url)
        return page

    yield opened
    for context in contexts:
        context.close()
    assert not errors, "\n".join(errors)


def _local(url: str) -> bool:
    return url.startswith(("http://127.0.0.1:", "ws://127.0.0.1:", "data:", "blob:", "about:"))


def shoot(page: Page, name: str) -> Path:
    """A screenshot of what is in view, in `out/screenshots`."""
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    file = SCREENSHOTS / f"{name}.png"
    page.screenshot(path=str(file), animations="disabled")
    return file


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """The closing line that all slow suites have."""
    stats = terminalreporter.stats
    failed = len(stats.get("failed", ())) + len(stats.get("error", ()))
    terminalreporter.write_line(f"{len(stats.get('passed', ()))} passed, {failed} failed")
