"""People and access: signing in and out, roles, and what one may not do."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from somrs.access.rights import PersonRole, Right
from somrs.access.store import AccessStore
from somrs.errors import UsageError
from somrs.trust.authority import Authority
from somrs.trust.enrolment import enrol
from tests.support.hang import HANG_TIME

from .conftest import RunningSystem, every_look, fits, running_in, sign_in, take_screenshot


@pytest.fixture
def profile(browser: Browser) -> Iterator[BrowserContext]:
    """A browser in which nobody has signed in, and whose console may tell of what is refused."""
    with browser.new_context() as context:
        yield context


def _printed_link(system: RunningSystem) -> str:
    """The link to sign in with that `somrs up` prints."""
    deadline = time.monotonic() + HANG_TIME
    while (link := re.search(r"once:\s+(\S+/sign-in\?link=\S+)\s", system.log_text())) is None:
        assert time.monotonic() < deadline, system.log_text()
        time.sleep(0.1)
    return link[1]


def test_a_new_system_makes_who_opens_the_link_its_administrator(system: RunningSystem, profile: BrowserContext) -> None:
    link = _printed_link(system)
    page = profile.new_page()
    page.goto(f"{system.url}/map?storey=Storey001")
    expect(page).to_have_url(re.compile(r"/sign-in\?next="))
    page.goto(link)
    page.get_by_label("Your name").fill("Tester")
    page.get_by_role("button", name="Begin").click()
    if page.get_by_role("alert").count():  # another test has signed in as the tester
        expect(page.get_by_role("alert")).to_contain_text("there is Tester already")
        page.get_by_label("Your name").fill("Ada Lovelace")
        page.get_by_role("button", name="Begin").click()
    expect(page.get_by_role("button", name="account")).to_be_visible()
    page.goto(link)
    expect(page).to_have_url(f"{system.url}/")  # the link was used, but one is signed in
    page.get_by_role("button", name="account").click()
    page.get_by_role("menuitem", name="Sign out").click()
    expect(page.get_by_role("button", name="Sign in")).to_be_visible()
    page.goto(link)
    expect(page.get_by_role("alert")).to_contain_text("This link was used")


def test_each_page_of_an_open_system_says_what_is_open(
    system: RunningSystem, tmp_path: Path, window: Callable[..., Page], profile: BrowserContext
) -> None:
    sign_in(profile, system.url)
    safe_page = profile.new_page()
    safe_page.goto(system.url)
    expect(safe_page.get_by_role("button", name="account")).to_be_visible()
    expect(safe_page.get_by_role("img", name="certificates")).to_have_count(0)
    with running_in(tmp_path, options=["--insecure"]) as open_system:
        page = window(open_system.url)
        for path in ("", "/tasks", "/fleet"):
            page.goto(f"{open_system.url}{path}")
            expect(page.get_by_role("img", name="Insecure: whoever reaches this address may do everything.")).to_be_visible()
            expect(page.get_by_role("img", name="Programs have no certificates: whoever reaches the ports")).to_be_visible()
        assert "Its programs have no certificates" in open_system.log_text()


def test_one_signs_in_with_a_password_and_gets_where_one_wanted(system: RunningSystem, profile: BrowserContext) -> None:
    store = AccessStore(system.data)
    store.add_account("Grace", PersonRole.OPERATOR)
    sign_in(profile, system.url, name="Grace")
    page = profile.new_page()
    page.goto(f"{system.url}/access")
    expect(page.get_by_role("heading", name="Grace")).to_be_visible()
    expect(page.get_by_text("Tokens of programs")).to_have_count(0)
    page.get_by_label("New password").fill("short")
    page.get_by_role("button", name="Set password").click()
    expect(page.get_by_text("a password has 10 to 1024 characters")).to_be_visible()
    page.get_by_label("New password").fill("a few easy words")
    page.get_by_role("button", name="Set password").click()
    expect(page.get_by_role("button", name="Change password")).to_be_visible()
    profile.clear_cookies()
    page.goto(f"{system.url}/fleet")
    for password in ("a few wrong words", "a few easy words"):
        page.get_by_label("Name").fill("Grace")
        page.get_by_label("Password").fill(password)
        page.get_by_role("button", name="Sign in").click()
        if password == "a few wrong words":
            expect(page.get_by_role("alert")).to_have_text("The name or the password is wrong.")
    expect(page).to_have_url(f"{system.url}/fleet")
    store.remove_account("Grace")  # the open page ends
    expect(page.get_by_role("button", name="Sign in")).to_be_visible()


def test_administrators_add_people_and_tokens(system: RunningSystem, window: Callable[..., Page]) -> None:
    page = window(f"{system.url}/access")
    page.get_by_label("Name", exact=True).fill("Katherine")
    page.get_by_role("button", name="Add person").click()
    secret = page.get_by_role("dialog").locator(".somrs-access-secret")
    expect(secret).to_contain_text("/sign-in?link=")
    page.get_by_role("button", name="Close").click()
    row = page.get_by_role("group", name="Katherine")
    expect(row).to_contain_text("0 sessions, without password")
    page.get_by_label("Name of the program").fill("stock keeping")
    page.get_by_role("button", name="Make token").click()
    token = page.get_by_role("dialog").locator(".somrs-access-secret").text_content() or ""
    page.get_by_role("button", name="Close").click()
    expect(page.get_by_role("group", name="stock keeping")).to_contain_text("see; until")
    answer = page.request.get(f"{system.url}/api/access/me", headers={"Authorization": f"Bearer {token}"})
    assert answer.json()["name"] == "stock keeping"
    for look in every_look(page):
        assert fits(page), look
        take_screenshot(page, f"access-{look}")
    row.get_by_role("button", name="Remove Katherine").click()
    page.get_by_role("alertdialog").get_by_role("button", name="Remove Katherine").click()
    expect(row).to_have_count(0)


def test_a_device_is_invited_in_the_window_enrols_and_is_revoked(
    system: RunningSystem, window: Callable[..., Page], profile: BrowserContext, tmp_path: Path
) -> None:
    authority = Authority.of_data(system.data)
    if not authority.exists:
        authority.create("site", datetime.now(UTC))
    sign_in(profile, system.url, PersonRole.ENGINEER, "Engineer")
    page = profile.new_page()
    page.goto(f"{system.url}/access")
    page.get_by_label("Name of the device").fill("Robot7")
    page.get_by_label("Also speaks for").fill("Arm7, Camera7")
    page.get_by_role("button", name="Invite").click()
    line = page.get_by_role("dialog").locator(".somrs-access-secret").text_content() or ""
    assert line.startswith("somrs trust enrol ")
    page.get_by_role("button", name="Close").click()
    expect(page.get_by_role("group", name="Robot7, invited")).to_contain_text("invited as device, until")
    expect(page.get_by_role("button", name="Withdraw")).to_have_count(0)
    enrol(authority, line.split()[3], ("127.0.0.1",), tmp_path, datetime.now(UTC))
    page = window(f"{system.url}/access")
    row = page.get_by_role("group", name="Robot7", exact=True)
    expect(row).to_contain_text("speaks for Arm7, Camera7")
    row.scroll_into_view_if_needed()
    for look in every_look(page):
        assert fits(page), look
        take_screenshot(page, f"devices-{look}")
    row.get_by_role("button", name="Revoke").click()
    page.get_by_role("alertdialog").get_by_role("button", name="Revoke Robot7").click()
    expect(row).to_have_count(0)
    with pytest.raises(UsageError, match="is revoked"):
        authority.check((tmp_path / "Robot7.pem").read_bytes(), datetime.now(UTC))
    log = page.locator("details").filter(has_text="Audit log")
    expect(log.get_by_role("group").filter(has_text="trust.invite").first).to_contain_text("Engineer")
    expect(log.get_by_role("group").filter(has_text="trust.revoke").first).to_contain_text("Robot7")
    expect(log).not_to_contain_text(line.split()[3])


def test_administrators_see_who_did_what(system: RunningSystem, window: Callable[..., Page], profile: BrowserContext) -> None:
    store = AccessStore(system.data)
    for number in range(30):
        store.add_token(f"Program {number}", frozenset({Right.SEE}), 3600.0)
    sign_in(profile, system.url, PersonRole.VIEWER, "Eve")
    assert profile.request.post(f"{system.url}/api/tasks", data={"effect": "Jar002 isOn Platform001"}).status == 403
    page = window(f"{system.url}/access")
    log = page.locator("details").filter(has_text="Audit log")
    denial = log.get_by_role("group").filter(has_text="tasks.submit")
    expect(denial).to_contain_text("Eve")
    expect(denial).to_contain_text("Denied")
    expect(denial).to_contain_text("does not have the right to operate")
    expect(log.get_by_role("group")).to_have_count(20)
    for look in every_look(page):
        assert fits(page), look
        take_screenshot(page, f"audit-{look}")
    log.get_by_role("button", name="Earlier entries").click()
    expect(log).to_contain_text("Program 0")
    assert log.get_by_role("group").count() > 30


def test_a_viewer_sees_and_stops_and_changes_nothing_else(system: RunningSystem, profile: BrowserContext) -> None:
    sign_in(profile, system.url, PersonRole.VIEWER, "Viewer")
    page = profile.new_page()
    page.goto(f"{system.url}/fleet")
    page.get_by_role("button", name="Stop all devices").click()
    release = page.locator(".somrs-release")
    expect(release).to_be_visible()
    expect(release).to_be_disabled()
    sign_in(profile, system.url, PersonRole.OPERATOR, "Operator")
    page.goto(f"{system.url}/map")
    release.click()
    expect(release).to_be_hidden()
    page.get_by_text("Changes").first.click()
    expect(page.get_by_text("Operator").first).to_be_visible()
    expect(page.get_by_text("Viewer").first).to_be_visible()
