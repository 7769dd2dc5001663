"""Make notebooks with outputs from the pages of the tutorials: python scripts/notebooks.py

Run `scripts/tutorials.py` first: a page holds the code, what it printed and its figures; nothing is executed here.
"""

import base64
import json
import re
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "tutorials"
BLOCK = re.compile(r"^```(python|text)\n(.*?)\n```$|^!\[Figure \d+\]\(([^)]+)\)$", re.M | re.S)


def notebook(page: Path) -> dict[str, Any]:
    """The notebook of a page, format 4.5 of nbformat."""
    text, cells, at = page.read_text(), [], 0
    text = text[: text.rfind("*This page is")]
    for block in BLOCK.finditer(text):
        add_markdown(cells, text[at : block.start()])
        at = block.end()
        language, body, picture = block.groups()
        if language == "python":
            cells.append(cell("code", body, cells) | {"execution_count": None, "outputs": []})
        elif language == "text":
            cells[-1]["outputs"].append({"output_type": "stream", "name": "stdout", "text": body + "\n"})
        else:
            image = base64.b64encode((page.parent / picture).read_bytes()).decode()
            shown = {"output_type": "display_data", "metadata": {}, "data": {"image/png": image}}
            cells[-1]["outputs"].append(shown)
    add_markdown(cells, text[at:])
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    return {"nbformat": 4, "nbformat_minor": 5, "metadata": kernel, "cells": cells}


def add_markdown(cells: list[dict[str, Any]], text: str) -> None:
    if text.strip():
        cells.append(cell("markdown", text.strip(), cells))


def cell(kind: str, source: str, before: list) -> dict[str, Any]:
    return {"id": f"cell-{len(before)}", "cell_type": kind, "metadata": {}, "source": source}


if __name__ == "__main__":
    for page in sorted(FOLDER.glob("*.md")):
        page.with_suffix(".ipynb").write_text(json.dumps(notebook(page), indent=1) + "\n")
        print(page.with_suffix(".ipynb"))
