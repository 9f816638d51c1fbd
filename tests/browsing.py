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
    "--disable-gpu-compositing",  # without a GPU it takes twice the time; WebGL is drawn all the same
)
WINDOW = {"width": 1280, "height": 800}


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


@pytest.fixture(scope="session")
def windows(browser):
    """The pages that are open by (number, options): a new one takes ten times as long as to open another file in it."""
    opened = {}

    def window(number, **options):
        key = (number, *sorted(options.items()))
        if key not in opened:
            opened[key] = browser.new_context(**options).new_page()
            opened[key].set_default_timeout(15_000)
        return opened[key]

    return window


@pytest.fixture
def window(windows):
    """Gives an empty page as ``window()``, with each call another one, in which nothing of other tests is left."""
    given = []

    def another(viewport=WINDOW, color_scheme="light", **options):
        page = windows(len(given), **options)
        given.append(page)
        page.set_viewport_size(viewport)
        page.emulate_media(color_scheme=color_scheme)
        page.mouse.move(0, 0)
        return page

    yield another
    for page in given:
        page.evaluate("localStorage.clear(), sessionStorage.clear()")
        page.goto("about:blank")


@pytest.fixture
def visit(window):
    """Opens a file as ``visit(path, hash="", allowed=path)``; it asks for nothing else, and reports no error.

    It is there as soon as it has what is asked for by ``shows``.
    """
    listening, problems = [], []

    def open_page(path, hash="", allowed=None, shows="main *", **options):
        page = window(**options)
        listeners = {
            "console": lambda message: _note_message(message, problems),
            "pageerror": lambda error: problems.append(f"error: {error}"),
            "request": lambda request: _note_request(request.url, allowed or path, problems),
        }
        for event, listener in listeners.items():
            page.on(event, listener)
            listening.append((page, event, listener))
        page.goto(f"file://{path}{hash}")
        page.wait_for_selector(shows, state="attached")
        return page

    yield open_page
    for page, event, listener in listening:
        page.evaluate("0")  # all that was reported before has arrived
        page.remove_listener(event, listener)
    assert not problems, problems


def _note_message(message, problems):
    """The browser itself reads the pixels of WebGL, without a GPU, and warns of that."""
    if "GPU stall due to ReadPixels" not in message.text:
        problems.append(f"{message.type}: {message.text}")


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
