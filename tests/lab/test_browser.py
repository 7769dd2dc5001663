"""The page in a real Chromium: the whole path at three widths, on the small bench."""

import re
import shutil
import socket
import threading
import time

import pytest
import uvicorn

from tests.lab.test_server import found
from visaug.diagnosis import session as session_module
from visaug.lab import application

playwright = pytest.importorskip("playwright.sync_api")
CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
TOKEN = "a-token-of-this-test"
WIDTHS = (420, 1280, 1920)


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as running:
        playwright.expect.set_options(timeout=20_000)  # of a busy machine
        browser = running.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def lab(bench, monkeypatch):
    """The address of a served bench whose diagnosis takes no time."""
    monkeypatch.setattr(session_module, "diagnose", lambda *_, **__: found(bench))
    listener = socket.create_server(("127.0.0.1", 0))
    app = application(bench, TOKEN)
    server = uvicorn.Server(uvicorn.Config(app, log_level="error"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
    thread.start()
    while not server.started:
        time.sleep(0.01)
    app.state.jobs.wait()
    yield f"http://127.0.0.1:{listener.getsockname()[1]}/?token={TOKEN}"
    app.state.pictures.closed = server.should_exit = True
    thread.join(20)


@pytest.fixture
def page(browser, lab):
    """A page that fails its test on any message of the console, and on anything asked of another host."""
    page = browser.new_page(viewport={"width": 1280, "height": 900}, accept_downloads=True)
    wrong = []
    page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on(
        "request", lambda r: None if re.match(r"(http://127|data:|blob:)", r.url) else wrong.append(r.url)
    )
    page.goto(lab)
    page.wait_for_selector("#bench[data-taken]")  # the script is there
    playwright.expect(error_of(page)).to_have_text("1.00")
    yield page
    page.close()
    # refusals are part of what is tested: a view that these frames do not show, a number out of range
    assert [line for line in wrong if not re.search("status of 40[04]", line)] == []


def error_of(page):
    return page.get_by_test_id("error")


def press(page, name):
    page.get_by_role("button", name=name, exact=True).click()


def overflow(page) -> int:
    return page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")


@pytest.mark.parametrize("width", WIDTHS)
def test_the_path_from_the_first_look_to_a_saved_camera(page, bench, width):
    page.set_viewport_size({"width": width, "height": 900})
    expect = playwright.expect
    verdict = page.get_by_test_id("verdict")
    expect(verdict).to_contain_text("does not explain these frames")
    page.get_by_role("button", name="Diagnose").focus()
    page.keyboard.press("Enter")
    expect(verdict).to_contain_text("The missing effect is row_noise")
    assert overflow(page) == 0
    press(page, "Add row_noise")
    expect(error_of(page)).to_have_text("0.01")
    expect(page.get_by_role("button", name="Remove row_noise")).to_be_focused()
    with page.expect_download() as download:
        press(page, "Save camera")
    assert "row_noise" in download.value.path().read_text()
    expect(page.locator("#notice")).to_contain_text(str(bench.output))
    assert bench.output.exists()
    press(page, "Undo")
    expect(error_of(page)).to_have_text("1.00")
    expect(page.locator("#redo")).to_be_enabled()
    press(page, "Redo")
    expect(error_of(page)).to_have_text("0.01")
    press(page, "Remove row_noise")
    expect(error_of(page)).to_have_text("1.00")
    assert overflow(page) == 0
