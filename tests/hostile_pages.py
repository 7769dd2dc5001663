"""Whether a page is as it should be in a real browser, whatever names it shows."""

from contextlib import contextmanager
from pathlib import Path

from tests.hostile import TEXT

LONG = "W" * 300
TURNED = "\u202eright to left\u2066"
NASTY = f"{TEXT} {TURNED} {LONG}"
WIDTHS = (420, 1280)


@contextmanager
def watched(browser, width: int):
    """A page that must not speak: no dialog, no error, no request beyond this machine, no script of a name."""
    page = browser.new_page(viewport={"width": width, "height": 900}, accept_downloads=True)
    page.set_default_timeout(120_000)  # of a busy machine
    wrong: list[str] = []
    page.add_init_script("window.evil = () => { window.evilRan = true; }")
    page.on("dialog", lambda dialog: (wrong.append(f"dialog {dialog.message}"), dialog.dismiss()))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda line: wrong.append(line.text) if line.type == "error" else None)
    page.on("request", lambda r: wrong.append(r.url) if not _is_here(r.url) else None)
    yield page
    ran = page.evaluate("Boolean(window.evilRan)")
    page.close()
    # refusals are part of what is tested: a view that these frames do not show, a number out of range
    assert [line for line in wrong if "status of 40" not in line] == []
    assert not ran


def _is_here(address: str) -> bool:
    return address.startswith(("http://127.0.0.1", "data:", "blob:", "file:"))


def overflow(page) -> int:
    """Pixels by which the page is wider than the window."""
    return page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")


def check_file(browser, path: Path) -> None:
    """A report with hostile names: nothing of them runs, nothing of them widens the page or turns its text."""
    for width in WIDTHS:
        with watched(browser, width) as page:
            page.goto(path.as_uri())
            assert overflow(page) == 0
            text = page.inner_text("body")
            assert not set(text) & set("\u202a\u202b\u202d\u202e\u2066\u2067\u2068")
