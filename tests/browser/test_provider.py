"""Signing in at an OpenID Connect provider, and out again."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from somrs.access.store import AccessStore
from tests.support.oidc_provider import RunningProvider, running_provider

from .conftest import SCHEMES, RunningSystem, fits, resize, running_in, take_looks, take_screenshot


@pytest.fixture(scope="module")
def provider() -> Iterator[RunningProvider]:
    with running_provider() as running:
        yield running


@pytest.fixture(scope="module")
def system(provider: RunningProvider, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSystem]:
    folder = tmp_path_factory.mktemp("provider")
    with running_in(folder, options=["--oidc", str(provider.write_settings(folder))]) as running:
        provider.send_back_to(running.url)
        yield running


def identify(page: Page, login: str) -> None:
    """Sign in at the provider's own page."""
    page.get_by_role("link", name="Sign in with Example Ltd").click()
    page.get_by_placeholder("Enter any login").fill(login)
    page.get_by_placeholder("and password").fill("any")
    page.get_by_role("button", name="Sign-in").click()


def test_the_provider_says_who_one_is_and_what_one_may_do(system: RunningSystem, browser: Browser) -> None:
    with browser.new_context() as profile:
        page = profile.new_page()
        page.goto(f"{system.url}/access")
        take_looks(page, "provider")
        identify(page, "ada")
        expect(page).to_have_url(f"{system.url}/access")
        expect(page.get_by_role("heading", name="Ada Lovelace")).to_be_visible()
        expect(page.get_by_text("which says what your role is")).to_be_visible()
        expect(page.get_by_label("New password")).to_have_count(0)
        take_screenshot(page, "provider-account")
        page.get_by_role("button", name="account").click()
        page.get_by_role("menuitem", name="Sign out").click()
        page.get_by_role("button", name="Yes, sign me out").click()
        expect(page).to_have_url(re.compile(f"^{system.url}/sign-in"))
        identify(page, "grace")
        expect(page.get_by_role("button", name="Grace: account")).to_be_visible()
        page.goto(f"{system.url}/access")
        row = page.get_by_role("group", name="Ada Lovelace").first
        expect(row).to_contain_text("0 sessions, signs in at http://127.0.0.1")
        expect(
            page.locator("details").filter(has_text="Audit log").get_by_role("group").filter(has_text="Ada Lovelace").first
        ).to_be_visible()
        take_screenshot(page, "provider-administrator")


def test_somebody_without_a_role_reads_why(system: RunningSystem, browser: Browser) -> None:
    with browser.new_context() as profile:
        page = profile.new_page()
        page.goto(system.url)
        identify(page, "eve")
        expect(page.get_by_role("alert")).to_have_text(
            "Example Ltd knows you as Eve, but has given you no role here. Ask who runs this site."
        )
        for scheme in SCHEMES:
            page.emulate_media(color_scheme=scheme)
            resize(page, "390")
            assert fits(page)
            take_screenshot(page, f"provider-no-role-{scheme}")
        assert "Eve" not in AccessStore(system.data).read().accounts
