"""Whatever words a command is given, it ends with a status, and never with a traceback; scripts/nightly runs many more examples."""

import contextlib
import io
import os
import signal
import tempfile
from pathlib import Path

import click
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from visaug.app.cli import main
from visaug.app.cli.root import program
from visaug.core.errors import InputError

EXAMPLES = int(os.environ.get("VISAUG_EXAMPLES", "12"))  # of each command
STATUSES = {None, 0, 1, 2, 3}
CAMERA = "{resolution: [6, 8], bit_depth: 12, gain_e_per_dn: 2.0, read_noise: {sigma_e: 4.0}}"
FILES = {
    "camera.yaml": CAMERA,
    "bad.yaml": "a: [1, 2\nb: }",
    "list.yaml": "[1, 2]",
    "plan.csv": "sequence,file,kind,photons\n0,b.tif,bias,\n1,f.tif,flat,300\n",
    "scores.json": '[{"file_name": "a.png", "keypoints": [1]}]',
    "broken.py": "raise SystemExit(7)\n",
    "frames/frames.csv": "sequence,file,kind\n0,gone.tif,bias\n",
    "empty": "",
}

numbers = st.sampled_from(
    ["0", "1", "2", "-1", "0.5", "1e-400", "1e400", "nan", "-inf", "9" * 30, "0:24", "24:0", "nan:1", "1:2:3", "0,1", "1,,x",
     "none", "6x8", "0x0", "٣", "1_0"]
)  # fmt: skip
places = st.sampled_from(
    [*FILES, "photos", "photos/a.png", "frames", "nowhere", "no/where", "loop", "x" * 300, ".", "..", "", "-", "a#b[0]", "own.html",
     "out", "out/camera.yaml", "out.html", "out.json", "/dev/null", "/proc/self/no", "\udcff", "sony_imx174", "row_noise"]
)  # fmt: skip
# No absolute paths out of free text: the commands write where they are told to.
free = st.text(st.characters(exclude_characters="/\0", exclude_categories=("Cs",)), max_size=6)
anything = places | numbers | free


def value_of(parameter: click.Parameter) -> st.SearchStrategy[str]:
    if isinstance(parameter.type, click.Choice):
        return st.sampled_from(list(parameter.type.choices)) | free
    if isinstance(parameter.type, click.Path) or parameter.name in ("camera_name", "camera_names"):
        return places | anything
    return anything if parameter.type is click.STRING else numbers | anything


@st.composite
def words_of(draw, command: click.Command) -> list[str]:
    """Each option now and then, mostly all that are required, and positional arguments."""
    words = []
    for parameter in command.params:
        wanted = draw(st.sampled_from([True] * 4 + [False]) if parameter.required else st.booleans())
        if not wanted:
            continue
        count = draw(st.integers(1, 3)) if parameter.nargs == -1 or parameter.multiple else 1
        for _ in range(count):
            if isinstance(parameter, click.Argument):
                words.append(draw(value_of(parameter)))
            elif parameter.is_flag:
                words.append(parameter.opts[-1])
            else:
                words += [draw(st.sampled_from(parameter.opts)), draw(value_of(parameter))]
    return words + draw(st.lists(anything | st.just("--"), max_size=1))


def refuse(*_, **__):
    raise InputError("as far as this test goes")


@pytest.fixture(autouse=True)
def cheap(monkeypatch):
    """What takes long is refused: the words have been checked by then."""
    import visaug.app.lab
    import visaug_train.demo

    for name in ("characterize", "compare", "diagnose"):
        monkeypatch.setattr(visaug, name, refuse)
    monkeypatch.setattr(visaug.app.lab, "serve", refuse)
    monkeypatch.setattr(visaug_train.demo, "run_demo", refuse)
    before, place = signal.getsignal(signal.SIGTERM), Path.cwd()
    yield
    signal.signal(signal.SIGTERM, before)
    os.chdir(place)


def ended(words: list[str]) -> object:
    """The exit status of the program, run in a folder of its own."""
    with tempfile.TemporaryDirectory() as base:
        folder = Path(base) / "here"
        for name, content in FILES.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(content)
        (folder / "photos").mkdir()
        Image.fromarray(np.full((4, 5), 90, np.uint8)).save(folder / "photos" / "a.png")
        (folder / "loop").symlink_to(folder / "loop")
        os.chdir(folder)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            try:
                main(words)
            except SystemExit as end:
                return end.code
            finally:
                os.chdir("/")
    return 0


@pytest.mark.parametrize("name", sorted(program.commands))
def test_any_words(name):
    @settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck))
    @given(words_of(program.commands[name]))
    def ends_with_a_status(words):
        assert ended([name, *words]) in STATUSES

    ends_with_a_status()
