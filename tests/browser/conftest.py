"""Real browsers at real systems: Debian's Chromium, driven by Playwright, at the processes that `somrs up` starts."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import pytest

from somrs.client.client import Addresses
from somrs.errors import UsageError
from tests.conftest import WORKER_GROUPS
from tests.support import warm
from tests.support.paths import ROOT, SCENARIO_1

playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Locator, Page, expect, sync_playwright  # noqa: E402  # behind the skip

CHROMIUM = (Path("/usr/bin/chromium-headless-shell"), Path("/usr/bin/chromium"))
"""The same browser without and with all around its pages, which takes a third more time and is seen by nobody: the first that there is."""
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
    "--disable-gpu-rasterization",
    # Of features only the last list counts, so this is Playwright's, as far as it matters here, and the pages of its own that Chromium
    # makes behind every window for what is typed into its address bar: nobody sees them here, and they take more time than ours.
    "--disable-features=AvoidUnnecessaryBeforeUnloadCheckSync,DestroyProfileOnBrowserClose,HttpsUpgrades,LensOverlay,MediaRouter,"
    "OptimizationHints,NetworkTimeServiceQuerying,PaintHolding,ThirdPartyStoragePartitioning,WebUIOmniboxPopup,WebUIOmniboxAimPopup",
)
SCREENSHOTS = ROOT / "out" / "screenshots"
WIDTHS = {"1280": (1280, 800), "1920": (1920, 1080), "820": (820, 1180)}
SIZES = {**WIDTHS, "640": (640, 480)}
"""The smallest is for what takes long to draw, and not for how it looks."""
SCHEMES: tuple[Literal["light", "dark"], ...] = ("light", "dark")
UP_TIME = 300.0
"""Seconds that a system has to start, on a machine that does much else, too."""
PATIENCE = 120.0
"""Seconds that anything else is waited for: as long as nobody would doubt that it does not come. What passes takes far less."""
WORK_TIME = 300_000
"""Milliseconds for robots to carry something, with a failure on the way."""


class RunningSystem:
    """A system that `somrs up` runs, with its windows."""

    def __init__(self, data: Path, site: Path = SCENARIO_1, speed: str = "4") -> None:
        self.data = data
        self.log = data.parent / f"{data.name}.log"
        self._process = warm.Program(["up", str(site), "--data", str(data), "--speed", speed], self.log)
        try:
            self.addresses = self._addresses()
        except BaseException:  # interrupted, too: no process is to be left
            self.stop()
            raise

    @property
    def url(self) -> str:
        assert self.addresses.gui is not None
        return self.addresses.gui

    def _addresses(self) -> Addresses:
        deadline = time.monotonic() + UP_TIME
        while time.monotonic() < deadline and not self._process.ended:
            try:
                addresses = Addresses.read(self.data)
            except UsageError:
                pass
            else:
                if addresses.gui is not None and "In the browser" in self.log_text():
                    return addresses
            time.sleep(0.1)
        raise AssertionError(f"the system did not start: {self.log_text()}")

    def log_text(self) -> str:
        """What its programs have written."""
        return self.log.read_text(encoding="utf-8", errors="replace")

    def kill(self, program: str) -> None:
        """SIGKILL one of its programs, such as `gui`; it is started again by itself."""
        self._signal(program, signal.SIGKILL)

    def _signal(self, program: str, signal_number: int) -> None:
        processes = subprocess.run(["pgrep", "-f", f"run {program} .*--data {self.data}"], capture_output=True, text=True, check=True)
        for id in processes.stdout.split():
            os.kill(int(id), signal_number)

    def kill_and_await(self, *programs: str) -> None:
        """The same, until all are back."""
        log_before = self.log_text()
        for program in programs:
            self.kill(program)
        deadline = time.monotonic() + UP_TIME
        while not all(f"{program} is back" in self.log_text()[len(log_before) :] for program in programs):
            assert time.monotonic() < deadline, f"not all came back: {self.log_text()[len(log_before) :]}"
            time.sleep(0.1)

    @contextmanager
    def paused(self, program: str) -> Iterator[None]:
        """One of its programs does nothing meanwhile."""
        self._signal(program, signal.SIGSTOP)
        try:
            yield
        finally:
            self._signal(program, signal.SIGCONT)

    @contextmanager
    def without_program(self, program: str) -> Iterator[None]:
        """One of its programs is killed, and not started again before the end."""
        self._process.send_signal(signal.SIGSTOP)
        try:
            self.kill(program)
            yield
        finally:
            self._process.send_signal(signal.SIGCONT)

    def stop(self) -> None:
        """End it at once, and all its programs, which would only take their leave of each other."""
        self._process.send_signal(signal.SIGSTOP)  # it is to start none of them again meanwhile
        programs = subprocess.run(["pgrep", "-P", str(self._process.pid)], capture_output=True, text=True)
        for id in programs.stdout.split():
            os.kill(int(id), signal.SIGKILL)
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()


@contextmanager
def running_in(folder: Path, speed: str = "4") -> Iterator[RunningSystem]:
    running = RunningSystem(folder / "data", speed=speed)
    try:
        yield running
    finally:
        running.stop()
    assert "Traceback" not in running.log_text(), f"a program of the system met a defect: see {running.log}"


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSystem]:
    with running_in(tmp_path_factory.mktemp("shared")) as running:
        yield running


@pytest.fixture(scope="module")
def system(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSystem]:
    """The paper's scenario, for all tests of one file, or of those that share it."""
    if f"browser/{request.path.stem}" in WORKER_GROUPS:
        yield request.getfixturevalue("shared")
    else:
        with running_in(tmp_path_factory.mktemp("browser")) as running:
            yield running


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    executable = next(filter(Path.exists, CHROMIUM), None)
    if executable is None:
        pytest.skip("there is no Chromium; on Debian and Ubuntu: sudo apt-get install chromium")
    expect.set_options(timeout=1000 * PATIENCE)
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=str(executable), args=[*FLAGS])
        yield browser
        browser.close()


class ExternalRequest(AssertionError):
    """A page asked for something from another machine."""


@pytest.fixture(scope="session")
def profiles(browser: Browser) -> list[BrowserContext]:
    """Profiles of the browser, as many as some test needed at the same time: whatever has been loaded once is known to them."""
    return []


FAILED = pytest.StashKey[bool]()
FAILURES = ROOT / "out" / "failures"
"""What the pages of a test showed when it failed, and what its system wrote."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed:
        item.stash[FAILED] = True
        for fixture in getattr(item, "funcargs", {}).values():
            if isinstance(fixture, RunningSystem):
                FAILURES.mkdir(parents=True, exist_ok=True)
                shutil.copy(fixture.log, FAILURES / f"{item.name}.log")
    return report


@pytest.fixture
def window(browser: Browser, profiles: list[BrowserContext], request: pytest.FixtureRequest) -> Iterator[Callable[..., Page]]:
    """Opens a page, each of a test in another browser profile, as of another person: `window(url, size="1280", dark=False)`. Whatever a
    page writes to the console as an error, and every request that would leave the machine, fails the test at its end; and a page that
    loads itself again, unless it `may_reload`."""
    pages: list[Page] = []
    errors: list[str] = []

    def open_page(url: str, size: str = "1280", *, dark: bool = False, may_reload: bool = False) -> Page:
        if len(pages) == len(profiles):
            profiles.append(browser.new_context())
        page = profiles[len(pages)].new_page()
        pages.append(page)
        page.set_default_timeout(1000 * PATIENCE)
        resize(page, size)
        page.emulate_media(color_scheme="dark" if dark else "light", reduced_motion="reduce")

        def check_console(message: ConsoleMessage) -> None:
            wrong = message.type == "error" and "ERR_CONNECTION" not in message.text
            if wrong or (message.text.startswith("reloading because") and not may_reload):
                errors.append(message.text)

        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", check_console)
        page.on("request", lambda sent_request: None if _local(sent_request.url) else errors.append(f"asked for {sent_request.url}"))
        page.goto(url)
        return page

    yield open_page
    for number, page in enumerate(pages, 1):
        if request.node.stash.get(FAILED, False):
            page.screenshot(path=FAILURES / f"{request.node.name}-{number}.png")
        page.close()
    for profile in profiles[: len(pages)]:
        profile.clear_cookies()
    assert not errors, "\n".join(errors)


def _local(url: str) -> bool:
    return url.startswith(("http://127.0.0.1:", "ws://127.0.0.1:", "data:", "blob:", "about:"))


def wait_until_still(drawn: Locator) -> None:
    """Wait until the page is laid out, to the last sign, and what is drawn stays where it is: for some pictures, however long each takes,
    and longer than Quasar waits before it makes room for the header."""
    script = """async (drawn) => {
        await document.fonts.ready;
        for (let [same, since, before] = [0, 0, ""]; (same < 5 || performance.now() - since < 300) && drawn.isConnected; ) {
            await new Promise(requestAnimationFrame);
            const now = JSON.stringify(drawn.getBoundingClientRect());
            if (now === before) same++;
            else [same, since, before] = [0, performance.now(), now];
        }
        return drawn.isConnected;
    }"""
    while not drawn.evaluate(script):  # it was drawn anew
        pass


def fits(page: Page) -> bool:
    """Whether nothing is wider than the window, once all signs are there, without which their names would be shown."""
    return bool(page.evaluate("document.fonts.ready.then(() => document.documentElement.scrollWidth <= window.innerWidth)"))


def every_look(page: Page) -> Iterator[str]:
    """The page in windows of all `WIDTHS`, light and dark; what each is called."""
    for size in WIDTHS:
        resize(page, size)
        for scheme in SCHEMES:
            page.emulate_media(color_scheme=scheme)
            yield f"{size}-{scheme}"


def resize(page: Page, size: str) -> None:
    width, height = SIZES[size]
    page.set_viewport_size({"width": width, "height": height})


def take_screenshot(page: Page, name: str) -> Path:
    """A screenshot of what is in view, in `out/screenshots`."""
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    file = SCREENSHOTS / f"{name}.png"
    page.screenshot(path=str(file), animations="disabled")
    return file
