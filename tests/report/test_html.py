"""A page holds what it was given, escaped, and refers to nothing outside itself."""

import base64
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from visaug.report.html import Figure, Page, Section, Table, Text, figure, render, write_page
from visaug.report.plots.style import blank, styled


def drawn():
    with styled():
        picture = blank(3, 2)
        axes = picture.subplots()
        axes.plot([0, 1], [0, 1], label="measured")
        axes.set(xlabel="mean / DN", ylabel="variance / DN²")
    return picture


class Outline(HTMLParser):
    """Tags with their attributes, and the text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.text = ""
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data


def page() -> Page:
    sections = [
        Section("One & two", [Text("a < b"), Table(["what", "value"], [["gain", "0.19"], ["name", "x"]])]),
        Section("Pictures", [figure(drawn(), "a line"), figure(drawn(), "pixels", raster=True)]),
        Section("Last", [Text("left over", "note")]),
    ]
    return Page("Title <b>", "lead", sections, facts=[("0.04", "error after")], footer="end")


def test_text_is_escaped_and_everything_is_there():
    outline = Outline(render(page()))
    for piece in ("a < b", "One & two", "0.19", "Title <b>", "0.04", "a line", "end"):
        assert piece in outline.text
    assert "b" not in [tag for tag, _ in outline.tags]


def test_refers_to_nothing_outside():
    outline = Outline(render(page()))
    links = [v for _, attributes in outline.tags for k, v in attributes.items() if k in ("src", "href")]
    assert links
    assert all(link.startswith(("data:", "#")) for link in links)
    assert not re.search(r"https?://|@import|url\(", render(page()))


def test_navigation_leads_to_sections():
    outline = Outline(render(page()))
    ids = {attributes.get("id") for tag, attributes in outline.tags if tag == "section"}
    anchors = {attributes["href"][1:] for tag, attributes in outline.tags if tag == "a"}
    assert anchors == ids
    assert len(ids) == 3


@pytest.mark.parametrize(
    ("raster", "mime", "magic"), [(True, "image/png", b"\x89PNG"), (False, "image/svg+xml", b"<?xml")]
)
def test_figure_is_inline_and_repeatable(raster, mime, magic):
    first, second = (figure(drawn(), "line", raster=raster) for _ in range(2))
    head, content = first.uri.split(",", 1)
    assert head == f"data:{mime};base64"
    assert base64.b64decode(content).startswith(magic)
    assert first == second


def test_columns_of_numbers_are_known():
    table = Table(["a", "b", "c"], [["x", "-1.5", ""], ["2", "[1, 2]", ""]])
    assert [table.is_number(i) for i in range(3)] == [False, True, False]


def test_broken_page_leaves_the_old_file(tmp_path):
    path = tmp_path / "report.html"
    write_page(path, page())
    before = path.read_bytes()
    with pytest.raises(Exception, match="anchor"):
        write_page(path, Page("new", "lead", [None]))  # type: ignore[arg-type]
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_figures_of_matplotlib_do_not_change_its_settings():
    import matplotlib as mpl

    before = mpl.rcParams["font.size"]
    with styled():
        assert mpl.rcParams["font.size"] != before
    assert mpl.rcParams["font.size"] == before
    assert np.isfinite(before)
    assert isinstance(figure(drawn(), "x"), Figure)
