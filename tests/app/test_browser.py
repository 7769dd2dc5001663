"""The page in a real Chromium: the whole path at three widths, on the small bench."""

import json
import re
import threading

import pytest
from PIL import Image

from tests.app.serving import see_everything, served
from tests.app.test_server import OWN, found
from tests.hostile_pages import overflow, watched
from visaug.diagnosis.session import session as session_module

expect = pytest.importorskip("playwright.sync_api").expect


@pytest.fixture
def open_lab(browser, bench, monkeypatch):
    """Opens the page of a bench whose diagnosis takes no time."""
    monkeypatch.setattr(session_module, "diagnose", lambda *_, **__: found(bench))

    def opened(page):
        page.goto(address)
        page.wait_for_selector("#bench[data-taken]")  # the script is there
        expect(error_of(page)).to_have_text("1.00")

    with served(bench) as address:
        yield opened


@pytest.fixture
def page(browser, open_lab):
    with watched(browser, 1280) as page:
        open_lab(page)
        yield page


def error_of(page):
    return page.get_by_test_id("error")


def press(page, name):
    page.get_by_role("button", name=name, exact=True).click()


@pytest.mark.parametrize(
    "width", [1280, *(pytest.param(width, marks=pytest.mark.slow) for width in (420, 1920))]
)
def test_the_path_from_the_first_look_to_a_saved_camera(browser, open_lab, bench, width):
    with watched(browser, width) as page:
        open_lab(page)
        verdict = page.get_by_test_id("verdict")
        expect(verdict).to_contain_text("does not explain these frames")
        assert verdict.bounding_box()["y"] < 800  # on the first screen
        expect(page.locator(".next")).to_contain_text("visaug diagnose")
        page.get_by_role("button", name="Diagnose").focus()
        page.keyboard.press("Enter")
        expect(verdict).to_contain_text("The missing effect is row_noise")
        press(page, "Add row_noise")
        expect(error_of(page)).to_have_text("0.01")
        expect(page.get_by_role("button", name="Remove row_noise")).to_be_focused()
        type_a_number(page, bench)
        see_everything(page)
        assert overflow(page) == 0
        read_a_curve(page)
        alternate_a_frame(page)
        with page.expect_download() as download:
            press(page, "Save camera")
        assert "row_noise" in download.value.path().read_text()
        expect(page.locator("#notice")).to_contain_text(str(bench.output))
        assert bench.output.exists()
        if width == 1280:  # the report does not depend on it
            with page.expect_download() as download:
                press(page, "Save report")
            assert "The camera with row_noise" in download.value.path().read_text()
        press(page, "Undo")
        expect(error_of(page)).to_have_text("1.00")
        page.reload()  # what was on the bench, and what was looked at
        expect(page.locator("#redo")).to_be_enabled()
        shown = page.locator("[data-view=frame] [aria-pressed=true]")
        page.locator("[data-view=frame]").scroll_into_view_if_needed()
        expect(shown).to_have_text("difference")
        press(page, "Redo")
        expect(error_of(page)).to_have_text("0.01")
        press(page, "Remove row_noise")
        expect(error_of(page)).to_have_text("1.00")
        assert overflow(page) == 0


def type_a_number(page, bench):
    """The error follows, the focus stays, and it is undone."""
    field = page.get_by_label("row_noise.sigma_e", exact=True)
    expect(field).to_have_value("2")
    field.fill("6")
    expect(page.get_by_test_id("verdict")).to_contain_text("set by hand")
    expect(field).to_be_focused()
    assert bench.camera.values()["row_noise.sigma_e"] == 6
    error = bench.now.fit.error
    assert error is None or error.value > 0.2  # three times the noise that is there
    press(page, "Undo")
    expect(error_of(page)).to_have_text("0.01")


def read_a_curve(page):
    """Values under the pointer, a zoom, and a table."""
    curve = page.locator(".curves").first
    curve.scroll_into_view_if_needed()
    over = curve.locator(".u-over")
    over.hover()
    expect(curve.locator(".u-legend .u-value").first).to_have_text(re.compile(r"\d"))
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
    page.wait_for_function("decodeURIComponent(location.hash).includes('\"x\"')")
    kept = json.loads(page.evaluate("decodeURIComponent(location.hash.slice(1))"))
    zoomed = next(view["x"] for view in kept["plots"].values() if view.get("x"))
    assert 0 < zoomed[0] < zoomed[1] < 63


def alternate_a_frame(page):
    """Pixel values, flicker, and the difference, which is left on."""
    frame = page.locator("[data-view=frame]")
    frame.locator("canvas").hover()
    expect(frame.locator(".value")).to_have_text(re.compile(r"row \d+, column \d+: measured \d"))
    frame.get_by_role("button", name=re.compile("alternate")).click()
    pressed = frame.locator("[aria-pressed=true]")
    expect(pressed.first).to_have_text("modelled")
    expect(pressed.first).to_have_text("measured")
    frame.get_by_role("button", name="difference").click()
    expect(pressed).to_have_text("difference")
    page.wait_for_function("decodeURIComponent(location.hash).includes('\"mode\":2')")


def test_numbers_are_dragged_and_refused(page, bench):
    press(page, "Diagnose")
    press(page, "Add row_noise")
    field = page.get_by_label("row_noise.sigma_e", exact=True)
    page.get_by_label("row_noise.sigma_e, slider").focus()
    page.keyboard.press("Home")
    expect(field).to_have_value("0")
    expect(page.get_by_test_id("verdict")).to_contain_text("set by hand")
    assert bench.camera.values()["row_noise.sigma_e"] == 0
    field.fill("-3")
    expect(page.locator("#message")).to_contain_text("row_noise.sigma_e")


def test_a_picture_of_ones_own(page, tmp_path):
    picture = tmp_path / "gray.png"
    Image.new("L", (40, 30), 128).save(picture)
    choose(page, "Choose a picture", picture)
    own = page.locator("[data-view=own]")
    own.scroll_into_view_if_needed()  # it is drawn when it is near
    own.locator("canvas").hover()
    expect(own.locator(".value")).to_contain_text("before 128, after 1")
    own.get_by_role("button", name="difference").click()
    expect(own.locator(".scale-text")).to_contain_text("255 is white")
    page.get_by_label("Light:").select_option("0.01")
    expect(own.locator(".scale-text")).to_contain_text("255 is white")
    page.wait_for_function("decodeURIComponent(location.hash).includes('0.01')")
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"no picture")
    choose(page, "Choose a picture", broken)
    expect(page.locator("#message")).to_contain_text("broken.png: cannot be read")
    page.reload()
    own.scroll_into_view_if_needed()
    expect(own.locator(".panel")).to_contain_text("gray.png")
    expect(page.get_by_label("Light:")).to_have_value("0.01")


def choose(page, button, path):
    with page.expect_file_chooser() as chooser:
        press(page, button)
    chooser.value.set_files(path)


def test_an_effect_file_runs_when_it_is_asked_for_and_not_before(page, bench, tmp_path):
    """The file leaves a mark when it is run."""
    mark = tmp_path / "has run"
    source = f"from pathlib import Path\nPath({str(mark)!r}).touch()\n{OWN}"
    (tmp_path / "mine.py").write_text(source)
    page.locator("#file").set_input_files(tmp_path / "mine.py")
    expect(page.locator("#chosen-name")).to_contain_text("mine.py")
    expect(page.locator("#chosen-lines")).to_contain_text("from visaug import Effect")
    expect(page.locator(".own-effect")).to_contain_text("runs the file’s Python code")
    page.wait_for_timeout(300)
    assert not mark.exists()
    assert bench.loaded == []
    press(page, "Load effect")
    expect(page.locator("#notice")).to_contain_text("loaded mine")
    expect(page.get_by_role("button", name="Add mine")).to_be_visible()
    expect(page.locator("#chosen")).to_be_hidden()
    assert mark.exists()
    (tmp_path / "mine.py").write_text(source.replace('"mine"', '"other"'))
    choose(page, "Load effect", tmp_path / "mine.py")
    expect(page.get_by_role("button", name="Add other")).to_be_visible()


def test_stopped_is_no_error(page, monkeypatch):
    go_on = threading.Event()

    def diagnose(*_, progress, **__):
        for i in range(1000):
            progress("trying smear", i, 1000)
            go_on.wait(0.02)

    monkeypatch.setattr(session_module, "diagnose", diagnose)
    press(page, "Diagnose")
    press(page, "Stop")
    expect(page.locator("#notice")).to_contain_text("stopped")
    expect(page.locator("#message")).to_be_hidden()
