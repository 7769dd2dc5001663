"""Names and texts that would be markup, a template or a formula, were they taken for more than text."""

from html.parser import HTMLParser

MARK = "<evil onevil=1>"
TEXT = f"\"'>{MARK}<script>evil()</script><img src=x onerror=evil()> $\\bad{{ {{{{7*7}}}} {{% x %}} ${{7*7}}"
LIVE = {"script", "iframe", "object", "embed", "base", "form", "link"}
# what the lab's page itself loads
OWN_ADDRESSES = ("lab.css?token=", "lab.js?token=", "plots.js?token=", "uplot.min.js?token=")


class Reader(HTMLParser):
    """What a browser would find in a page."""

    def __init__(self, page: str):
        super().__init__()
        self.live: list[str] = []
        self.text = ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        address = next((value or "" for key, value in attrs if key in ("src", "href")), "")
        if tag == "evil" or (tag in LIVE and not address.startswith((*OWN_ADDRESSES, "data:,"))):
            self.live.append(tag)
        for key, value in attrs:
            scripted = (value or "").strip().lower().startswith(("javascript:", "data:text"))
            if key.startswith("on") or scripted or (tag == "img" and value == "x"):
                self.live.append(f"{tag} {key}={value}")

    def handle_data(self, data: str) -> None:
        self.text += data


def check_page(page: str, shown: bool = True) -> None:
    """Nothing of TEXT is alive in a page of HTML; `shown`: it stands there as text."""
    found = Reader(page)
    assert found.live == []
    if shown:
        assert MARK in found.text
        assert "{{7*7}}" in found.text
