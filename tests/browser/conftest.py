"""Fixtures for tests in a real browser: Debian's Chromium, driven by Playwright, with a system that `somrs up` starts."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from itertools import cycle, product
from pathlib import Path
from typing import Literal

import pytest

from somrs.access.rights import PersonRole
from somrs.client.addresses import Addresses
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import UsageError
from tests.conftest import WORKER_GROUPS
from tests.support import warm
from tests.support.paths import ROOT, SCENARIO_1
from tests.support.signed_in import TESTER, note, session_cookies

playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Locator, Page, expect, sync_playwright  # noqa: E402  # behind the skip

CHROMIUM = (Path("/usr/bin/chromium-headless-shell"), Path("/usr/bin/chromium"))
"""Chromium without and with its own user interface, in order of preference. The second takes a third more time."""
FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-gpu-compositing",  # pages are drawn without GL, which is slow software rendering here; only the 3D view needs it
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-rasterization",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost",  # requests to other machines are errors on the console
    "--js-flags=--no-maglev --no-opt",  # pages of tests end before optimized code pays
    "--process-per-site",  # so that a page need not start a process, nor compile scripts: see `profiles`
    # Only the last list of features counts, so this contains the relevant part of Playwright's list. It also disables the pages that
    # Chromium makes for its address bar behind every window, which take more time than the pages under test; and scripts that are compiled
    # while they are loaded, each time again, though the process has compiled them for the page before.
    "--disable-features=AvoidUnnecessaryBeforeUnloadCheckSync,DestroyProfileOnBrowserClose,HttpsUpgrades,LensOverlay,MediaRouter,"
    "OptimizationHints,NetworkTimeServiceQuerying,PaintHolding,ScriptStreaming,ThirdPartyStoragePartitioning,WebUIOmniboxPopup,"
    "WebUIOmniboxAimPopup",
)
SCREENSHOTS = ROOT / "out" / "screenshots"
WIDTHS = {"1280": (1280, 800), "1920": (1920, 1080), "820": (820, 1180)}
SIZES = {**WIDTHS, "640": (640, 480), "390": (390, 844)}
"""640 is for pages that take long to draw and whose layout is not tested; 390 is a telephone."""
SIZE = "1280"
"""The size of a new page, unless a test selects another."""
Scheme = Literal["light", "dark"]
SCHEMES: tuple[Scheme, ...] = ("light", "dark")
UP_TIME = 300.0
"""Seconds for a system to start, on a busy machine, too."""
PATIENCE = 30.0 if os.environ.get("SOMRS_BROWSER_LATENCY", "0") != "0" else 120.0
"""Seconds to wait for anything else. It is generous: a test that passes waits far less."""
WORK_TIME = 300_000
"""Milliseconds for robots to carry something, including the recovery from a failure."""
LATENCY = int(os.environ.get("SOMRS_BROWSER_LATENCY", "0"))
"""Milliseconds by which what the server and a page tell each other is late, in each direction: tests that act before the page is ready fail
with it, and not at random."""
_SLOW_NETWORK = """
const { set } = Object.getOwnPropertyDescriptor(WebSocket.prototype, "onmessage");
Object.defineProperty(WebSocket.prototype, "onmessage", {
  set(handler) { set.call(this, handler && ((event) => setTimeout(() => handler.call(this, event), DELAY))); },
});
const { send } = WebSocket.prototype;
const onTheWay = new Set();
WebSocket.prototype.send = function (message) {
  const deliver = () => onTheWay.delete(deliver) && this.readyState === WebSocket.OPEN && send.call(this, message);
  onTheWay.add(deliver);
  setTimeout(deliver, DELAY);
};
addEventListener("pagehide", () => onTheWay.forEach((deliver) => deliver())); // what a page has sent arrives although the page is left
const { fetch } = window;
const pause = () => new Promise((resolve) => setTimeout(resolve, DELAY));
window.fetch = (...request) => pause().then(() => fetch(...request)).finally(pause); // the answer waits for the second pause, too
"""


def slow_network(delay: int) -> str:
    """A script that makes messages to and from a page late by so many milliseconds."""
    return f"{{{_SLOW_NETWORK.replace('DELAY', str(delay))}}}"


WITHOUT_WEBGL = """
const { getContext } = HTMLCanvasElement.prototype;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return /webgl/.test(kind) ? null : getContext.call(this, kind, ...more);
};
"""
"""A script for pages that draw nothing in 3D, and tell of it in words."""

HOLDING_NEWS = """
const { set } = Object.getOwnPropertyDescriptor(WebSocket.prototype, "onmessage");
const heldNews = [];
let holdsNews = false;
Object.defineProperty(WebSocket.prototype, "onmessage", {
  set(handler) {
    const hears = (event) => {
      if (holdsNews && event.data !== "2") heldNews.push(() => hears(event)); // "2" only asks whether the page is there
      else handler.call(this, event);
    };
    set.call(this, handler && hears);
  },
});
window.holdNews = () => (holdsNews = true);
window.releaseNews = () => {
  holdsNews = false;
  heldNews.splice(0).forEach((hear) => hear());
};
"""
"""A script for pages that hear nothing from the server between `holdNews()` and `releaseNews()`."""


class RunningSystem:
    """A system that `somrs up` runs, with its GUI. In a kinematic world, robots do the same in a fraction of the CPU time of physics."""

    def __init__(
        self, data: Path, site: Path = SCENARIO_1, speed: str = "4", world: WorldKind = WorldKind.KINEMATIC, options: Sequence[str] = ()
    ) -> None:
        self.data = data
        self.log = data.parent / f"{data.name}.log"
        arguments = ["up", str(site), "--data", str(data), "--speed", speed, "--world", world, *options]
        self._process = warm.Program(arguments, self.log)
        try:
            self.addresses = self._addresses()
            note(data, self.addresses.gui, self.addresses.api)
        except BaseException:  # also an interrupt: no process may be left
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
        """Return the output of its programs."""
        return self.log.read_text(encoding="utf-8", errors="replace")

    def kill(self, program: str) -> None:
        """SIGKILL one of its programs, such as `gui`; the system restarts it."""
        self._signal(program, signal.SIGKILL)

    def _signal(self, program: str, signal_number: int) -> None:
        processes = subprocess.run(["pgrep", "-f", f"run {program} .*--data {self.data}"], capture_output=True, text=True, check=True)
        for id in processes.stdout.split():
            os.kill(int(id), signal_number)

    def kill_and_await(self, *programs: str, while_paused: str | None = None) -> None:
        """SIGKILL the programs, and wait until the system has restarted them. `while_paused`: a program that does nothing until they are
        killed."""
        log_before = self.log_text()
        with nullcontext() if while_paused is None else self.paused(while_paused):
            for program in programs:
                self.kill(program)
        deadline = time.monotonic() + UP_TIME
        while not all(f"{program} is back" in self.log_text()[len(log_before) :] for program in programs):
            assert time.monotonic() < deadline, f"not all programs restarted: {self.log_text()[len(log_before) :]}"
            time.sleep(0.1)

    @contextmanager
    def paused(self, program: str) -> Iterator[None]:
        """A context in which one of its programs is stopped (SIGSTOP), and not ended for that: none is restarted meanwhile."""
        self._process.send_signal(signal.SIGSTOP)
        self._signal(program, signal.SIGSTOP)
        try:
            yield
        finally:
            self._signal(program, signal.SIGCONT)
            self._process.send_signal(signal.SIGCONT)

    @contextmanager
    def without_program(self, program: str) -> Iterator[None]:
        """A context in which one of its programs is killed and not restarted."""
        self._process.send_signal(signal.SIGSTOP)
        try:
            self.kill(program)
            yield
        finally:
            self._process.send_signal(signal.SIGCONT)

    def stop(self) -> None:
        """SIGKILL the system and all its programs, to save the time of an orderly end."""
        self._process.send_signal(signal.SIGSTOP)  # it must not restart programs
        programs = subprocess.run(["pgrep", "-P", str(self._process.pid)], capture_output=True, text=True)
        for id in programs.stdout.split():
            os.kill(int(id), signal.SIGKILL)
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()


@contextmanager
def running_in(
    folder: Path, speed: str = "4", world: WorldKind = WorldKind.KINEMATIC, options: Sequence[str] = ()
) -> Iterator[RunningSystem]:
    running = RunningSystem(folder / "data", speed=speed, world=world, options=options)
    try:
        yield running
    finally:
        running.stop()
    assert "Traceback" not in running.log_text(), f"a program of the system raised an error: see {running.log}"


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSystem]:
    with running_in(tmp_path_factory.mktemp("shared")) as running:
        yield running


@pytest.fixture(scope="module")
def system(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSystem]:
    """The paper's scenario, for all tests of one file, or of the files that share it."""
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


@pytest.fixture(scope="session")
def profiles(browser: Browser) -> list[BrowserContext]:
    """The browser profiles so far, as many as tests needed at the same time. They are used again, as they have files in their caches, and
    a process that has compiled the scripts of the pages."""
    return []


def new_profile(browser: Browser) -> BrowserContext:
    """Return a profile with an empty page that keeps its process, in which all pages of this machine run."""
    width, height = SIZES[SIZE]
    profile = browser.new_context(viewport={"width": width, "height": height}, color_scheme="light", reduced_motion="reduce")
    if LATENCY:
        profile.add_init_script(slow_network(LATENCY))
    page = profile.new_page()
    page.route("**", lambda route: route.fulfill(body="", content_type="text/html"))
    page.goto("http://127.0.0.1/")
    return profile


def empty_page(profile: BrowserContext) -> Page:
    """Open a page from the one that keeps the profile's process. Playwright's `new_page` starts another process for a page, which ends when
    the page goes to its first address: that takes a third of the time of a small page."""
    with profile.expect_page() as opened:
        profile.pages[0].evaluate("() => void open('about:blank')")
    return opened.value


def sign_in(profile: BrowserContext, url: str, role: PersonRole = PersonRole.ADMINISTRATOR, name: str = TESTER) -> None:
    """Sign a person in in all pages of a profile: at the system with this page, or, for an empty page, at all."""
    for cookie, secret, address in session_cookies(url, role, name):
        profile.add_cookies([{"name": cookie, "value": secret, "url": address}])


FAILED = pytest.StashKey[bool]()
FAILURES = ROOT / "out" / "failures"
"""The folder for screenshots and logs of failed tests."""


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
    """A function that opens a page in a new profile, as of another person: `window(url, size="1280", dark=False)`. Without `webgl`, pages
    draw nothing in 3D, which takes longer than all else on them. The test fails at its end if a page logged an error to the console, such
    as for a request to another machine, or, unless it `may_reload`, reloaded itself."""
    pages: list[Page] = []
    errors: list[str] = []

    def open_page(url: str, size: str = SIZE, *, dark: bool = False, may_reload: bool = False, webgl: bool = True) -> Page:
        if len(pages) == len(profiles):
            profiles.append(new_profile(browser))
        profile = profiles[len(pages)]
        sign_in(profile, url)
        page = empty_page(profile)
        pages.append(page)
        page.set_default_timeout(1000 * PATIENCE)
        if not webgl:
            page.add_init_script(f"{{{WITHOUT_WEBGL}}}")
        if size != SIZE:
            resize(page, size)
        if dark:
            page.emulate_media(color_scheme="dark")

        def check_console(message: ConsoleMessage) -> None:
            wrong = message.type == "error" and "ERR_CONNECTION" not in message.text
            if wrong or (message.text.startswith("reloading because") and not may_reload):
                errors.append(f"{message.text} ({message.location['url']})")

        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", check_console)
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


def wait_until_still(drawn: Locator) -> None:
    """Wait until the page's fonts are loaded and the element stays in place for five frames and 300 ms, which is longer than Quasar waits
    before it lays out the header. Not all frames are looked at: each has the whole page drawn."""
    script = """async (drawn) => {
        await document.fonts.ready;
        for (let [same, before] = [0, ""]; same < 5 && drawn.isConnected; ) {
            await new Promise((resolve) => setTimeout(resolve, 60));
            await new Promise(requestAnimationFrame);
            const now = JSON.stringify(drawn.getBoundingClientRect());
            [same, before] = [now === before ? same + 1 : 0, now];
        }
        return drawn.isConnected;
    }"""
    while not drawn.evaluate(script):  # the element was replaced
        pass


def fits(page: Page) -> bool:
    """Whether nothing is wider than the window. Waits for the fonts, without which icons would show as long names."""
    return bool(page.evaluate("document.fonts.ready.then(() => document.documentElement.scrollWidth <= window.innerWidth)"))


def looks(sizes: Iterable[str]) -> list[tuple[str, Scheme]]:
    """Each size with each color scheme if `ALL_LOOKS` is set; otherwise each size with one of them in turn, as the width of a page does not
    depend on its colors. Tests that use this are marked `looks`."""
    if "ALL_LOOKS" in os.environ:
        return list(product(sizes, SCHEMES))
    return list(zip(sizes, cycle(SCHEMES), strict=False))


def every_look(page: Page) -> Iterator[str]:
    """Set each of the `looks` of `WIDTHS`, and yield its name."""
    for size, scheme in looks(WIDTHS):
        resize(page, size)
        page.emulate_media(color_scheme=scheme)
        yield f"{size}-{scheme}"


def take_looks(page: Page, name: str) -> None:
    """Save screenshots of a page on a screen and on a phone, light and dark, and see that it fits."""
    for scheme, size in product(SCHEMES, ("1280", "390")):
        page.emulate_media(color_scheme=scheme)
        resize(page, size)
        assert fits(page)
        take_screenshot(page, f"{name}-{size}-{scheme}")
    resize(page, "1280")


def resize(page: Page, size: str) -> None:
    width, height = SIZES[size]
    page.set_viewport_size({"width": width, "height": height})


def take_screenshot(page: Page, name: str) -> None:
    """Save a screenshot of the visible part in `out/screenshots`, for people to look at, unless `NO_SCREENSHOTS` is set."""
    if "NO_SCREENSHOTS" not in os.environ:
        SCREENSHOTS.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=str(SCREENSHOTS / f"{name}.png"), animations="disabled")
