"""The page in a real Chromium: the whole path at three widths, on the small bench."""

import json
import re
import shutil
import socket
import threading
import time

import pytest
import uvicorn
from PIL import Image

from tests.lab.test_server import OWN, found
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


def test_numbers_are_typed_and_dragged(page, bench):
    expect = playwright.expect
    press(page, "Diagnose")
    press(page, "Add row_noise")
    field = page.get_by_label("row_noise.sigma_e", exact=True)
    expect(field).to_have_value("2")
    field.fill("6")
    expect(page.get_by_test_id("verdict")).to_contain_text("set by hand")
    expect(field).to_be_focused()
    assert bench.camera.values()["row_noise.sigma_e"] == 6
    assert (
        bench.now.fit.error is None or bench.now.fit.error.value > 0.2
    )  # three times the noise that is there
    slider = page.get_by_label("row_noise.sigma_e, slider")
    slider.focus()
    page.keyboard.press("Home")
    expect(page.get_by_label("row_noise.sigma_e", exact=True)).to_have_value("0")
    for _ in range(200):
        if bench.camera.values().get("row_noise.sigma_e") == 0:
            break
        page.wait_for_timeout(50)
    assert bench.camera.values()["row_noise.sigma_e"] == 0
    field.fill("-3")
    expect(page.locator("#message")).to_contain_text("row_noise.sigma_e")


def test_curves_and_maps_are_read_zoomed_and_kept(page):
    curve = page.locator(".curves").first
    curve.scroll_into_view_if_needed()
    over = curve.locator(".u-over")
    over.hover()
    playwright.expect(curve.locator(".u-legend .u-value").first).to_have_text(re.compile(r"\d"))
    box = over.bounding_box()
    page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 50)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 60)
    page.mouse.up()
    with page.expect_download() as download:
        curve.get_by_role("button", name=re.compile("^CSV of")).click()
    lines = download.value.path().read_text().splitlines()
    assert len(lines) == 65  # a head and 64 rows
    assert lines[0].startswith('"curve","row"')
    canvas = page.locator("[data-view=frame] canvas")
    canvas.scroll_into_view_if_needed()
    canvas.hover()
    value = page.locator("[data-view=frame] .value")
    playwright.expect(value).to_have_text(re.compile(r"row \d+, column \d+: measured \d"))
    shown = page.locator("[data-view=frame] [aria-pressed=true]")
    page.locator("[data-view=frame]").get_by_role("button", name="difference").click()
    playwright.expect(shown).to_have_text("difference")
    page.locator("[data-view=frame]").get_by_role("button", name=re.compile("alternate")).click()
    playwright.expect(shown.first).to_have_text(re.compile("measured|modelled"))
    page.locator("[data-view=frame]").get_by_role("button", name="difference").click()
    page.wait_for_function("decodeURIComponent(location.hash).includes('frame')")
    kept = json.loads(page.evaluate("decodeURIComponent(location.hash.slice(1))"))
    assert kept["plots"]["frame"]["mode"] == 2
    zoomed = next(view["x"] for view in kept["plots"].values() if view.get("x"))
    assert 0 < zoomed[0] < zoomed[1] < 63
    page.reload()
    canvas.scroll_into_view_if_needed()
    playwright.expect(shown).to_have_text("difference")


def test_a_picture_of_ones_own_and_an_effect(page, tmp_path):
    picture = tmp_path / "gray.png"
    Image.new("L", (40, 30), 128).save(picture)
    page.locator("#own-file").set_input_files(picture)
    canvas = page.locator("#own-view canvas")
    canvas.scroll_into_view_if_needed()
    canvas.hover()
    playwright.expect(page.locator("#own-view .value")).to_contain_text("clean 0.50")
    (tmp_path / "mine.py").write_text(OWN)
    page.locator("#file").set_input_files(tmp_path / "mine.py")
    playwright.expect(page.locator("#notice")).to_contain_text("loaded mine")
    playwright.expect(page.get_by_role("button", name="Add mine")).to_be_visible()
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"no picture")
    page.locator("#own-file").set_input_files(broken)
    playwright.expect(page.locator("#own-state")).to_contain_text("cannot be read as a picture")


def test_stopped_is_no_error(page, monkeypatch):
    go_on = threading.Event()

    def diagnose(*_, progress, **__):
        for i in range(1000):
            progress("trying smear", i, 1000)
            go_on.wait(0.02)

    monkeypatch.setattr(session_module, "diagnose", diagnose)
    press(page, "Diagnose")
    press(page, "Stop")
    playwright.expect(page.locator("#notice")).to_contain_text("stopped")
    playwright.expect(page.locator("#message")).to_be_hidden()
