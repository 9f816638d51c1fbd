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
    """Opens a file as ``visit(path, hash="", allowed=path)``; it asks for nothing else, and reports no error."""
    contexts, problems = [], []

    def open_page(path, hash="", allowed=None, **options):
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}} | options)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(15_000)
        page.on("console", lambda message: problems.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: problems.append(f"error: {error}"))
        page.on("request", lambda request: _note_request(request.url, allowed or path, problems))
        page.goto(f"file://{path}{hash}")
        page.wait_for_selector("main *", state="attached")
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert problems == []


def _note_request(url, allowed, problems):
    """A page may ask for itself, or for the files of its folder, and for what it holds."""
    if not url.startswith((f"file://{allowed}", "data:", "blob:")):
        problems.append(f"request: {url}")


@pytest.fixture(scope="session")
def small(tmp_path_factory):
    """A folder of results that no method has made."""
    from made_results import make

    return make(tmp_path_factory.mktemp("made") / "small")


@pytest.fixture(scope="session")
def small_data(small):
    """What a page of these results is made of."""
    from bench.pages.data import page_data

    return page_data(small.rows(use_index=False), [small], title="A <b>title</b> & more")


@pytest.fixture(scope="session")
def small_page(small_data, tmp_path_factory):
    """The page itself."""
    from bench.pages.assemble import one_file

    path = tmp_path_factory.mktemp("pages") / "page.html"
    path.write_text(one_file(small_data), encoding="utf-8")
    return path
