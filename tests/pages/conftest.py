"""A browser for the tests of pages: headless Chromium, which asks no network for anything."""

from __future__ import annotations

import shutil

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = (
    "--no-sandbox",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)


@pytest.fixture(scope="session")
def browser():
    """Chromium of the system; the tests of pages need one."""
    from playwright.sync_api import sync_playwright

    found = next(filter(None, map(shutil.which, NAMES)), None)
    assert found, f"the tests of pages need a browser: install one of {', '.join(NAMES)} (apt-get install chromium)"
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=found, args=list(ARGUMENTS))
        yield opened
        opened.close()


@pytest.fixture
def visit(browser):
    """Opens a file as ``visit(path, hash="", **context)``; the page must ask for no address and report no error."""
    contexts, problems = [], []

    def open_page(path, hash="", **options):
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}} | options)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(15_000)
        page.on("console", lambda message: problems.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: problems.append(f"error: {error}"))
        page.on("request", lambda request: _note_request(request.url, path, problems))
        page.goto(f"file://{path}{hash}")
        page.wait_for_selector("main *", state="attached")
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert problems == []


def _note_request(url, path, problems):
    """A page may ask for itself, for files beside it, and for what it holds."""
    if not url.startswith((f"file://{path.parent}", "data:", "blob:")):
        problems.append(f"request: {url}")
