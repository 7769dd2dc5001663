"""Whatever a file holds, reading it gives a value or an InputError; scripts/nightly runs many more examples."""

import contextlib
import csv
import io
import json
import os
import tempfile
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import visaug
from visaug.core.documents import parse_json, parse_yaml
from visaug.core.errors import InputError
from visaug.frames import FrameSet, read_table
from visaug.frames.sources import read_descriptor
from visaug_train.config import check_config
from visaug_train.geometry import Keypoints, Pinhole

EXAMPLES = int(
    os.environ.get("VISAUG_EXAMPLES", "30")
)  # of each test; those of frames and store have hundreds
many = settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck))
words = st.sampled_from(
    ["name", "resolution", "gain_e_per_dn", "bit_depth", "read_noise", "sigma_e", "effects", "row_noise", "randomize", "std",
     "gain_db", "prnu", "map", "dark_current", "exposure_s", "colour", "cfa", "arms", "baseline", "data", "rendered", "seeds",
     "output", "training", "vis", "camera", "Nu", "Nv", "cameraMatrix", "distCoeffs", "points_m", "uniform", "log_uniform"]
)  # fmt: skip
leaves = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | words
    | st.just(10**400)
    | st.just([640, 480])
)
values = st.recursive(
    leaves,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(words | st.text(max_size=3), inner, max_size=5)
    ),
    max_leaves=12,
)
CAMERA = {
    "name": "n",
    "resolution": [8, 8],
    "gain_e_per_dn": 2.0,
    "effects": [{"name": "row_noise", "sigma_e": 1.0}],
}
SMALL = visaug.Camera.load({"resolution": [8, 8], "gain_e_per_dn": 2.0})
CONFIG = {
    "name": "n",
    "output": "o",
    "data": {"rendered": {}},
    "arms": {"baseline": {"vis": {"camera": "sony_imx174"}}},
}


@st.composite
def altered(draw, start):
    """A right document with one place changed to any value."""
    content = json.loads(json.dumps(start))
    place = content
    while isinstance(place, dict | list) and place:
        key = draw(st.sampled_from(sorted(place) if isinstance(place, dict) else range(len(place))))
        if not isinstance(place[key], dict | list) or draw(st.booleans()):
            place[key] = draw(values)
            break
        place = place[key]
    if draw(st.booleans()):
        content[draw(words)] = draw(values)
    return content


def tried(what, *arguments):
    with contextlib.suppress(InputError):
        what(*arguments)


@many
@given(st.text() | st.binary().map(lambda b: b.decode("latin-1")))
def test_any_text_as_yaml_and_json(text):
    tried(parse_yaml, text)
    tried(parse_json, text)


@many
@given(values)
def test_any_value_as_yaml(value):
    tried(parse_yaml, yaml.safe_dump(value))


@many
@given(altered(CAMERA) | values)
def test_any_content_of_a_camera(content):
    if isinstance(content, dict):
        tried(visaug.Camera.load, content)


@many
@given(altered(CONFIG) | values)
def test_any_content_of_a_config(content):
    tried(check_config, content)


def in_file(suffix, content, what):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"file{suffix}"
        path.write_bytes(content)
        tried(what, path)


@many
@given(values)
def test_any_content_of_keypoints_and_pinhole(content):
    in_file(".yaml", yaml.safe_dump(content).encode(), Keypoints.load)
    in_file(".json", json.dumps(content).encode(), Pinhole.load)


cells = st.text(max_size=6) | st.sampled_from(
    [
        "0",
        "1",
        "-1",
        "1e400",
        "nan",
        "inf",
        "9" * 30,
        "bias",
        "flat",
        "dark",
        "scene",
        "a.npy",
        "a.npz#k[0]",
        "0:4,0:4",
        "\0",
        "../x",
    ]
)


@many
@given(st.lists(st.lists(cells, max_size=9), max_size=4), st.booleans(), st.binary(max_size=40))
def test_any_table_of_frames(rows, headed, rest):
    text = io.StringIO()
    writer = csv.writer(text, escapechar="\\", quoting=csv.QUOTE_ALL)
    if headed:
        writer.writerow(
            [
                "sequence",
                "file",
                "kind",
                "exposure_s",
                "temperature_c",
                "gain_db",
                "photons",
                "clean",
                "region",
            ]
        )
    writer.writerows(rows)
    content = text.getvalue().encode(errors="replace") + rest
    in_file(".csv", content, read_table)
    in_file(".csv", content, FrameSet.load)
    in_file(".txt", content, read_descriptor)


@many
@given(st.data())
def test_any_arguments_of_public_constructors(data):
    draw = data.draw
    anything = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
    what = draw(st.sampled_from(["noise", "record", "effect"]))
    if what == "noise":
        names = [
            "p",
            "transfer",
            "mono",
            "gain_db",
            "exposure",
            "strength",
            "fixed_pattern",
            "black_level",
            "resolution",
        ]
        options = draw(st.dictionaries(st.sampled_from(names), anything, max_size=2))
        tried(lambda: visaug.VISNoise(SMALL, **options))
    elif what == "record":
        tried(
            lambda: visaug.frames.FrameRecord(
                draw(st.integers()), draw(st.text()), draw(st.text()), draw(st.floats())
            )
        )
    else:
        effect = draw(st.sampled_from(sorted(visaug.effects.catalogue())))
        known = visaug.effects.catalogue()[effect]
        tried(
            lambda: known(
                **draw(st.dictionaries(st.sampled_from([*known.parameters, "no_such"]), anything, max_size=2))
            )
        )


@pytest.mark.parametrize("name", ["x" * 300, "a\0b", "", "/dev/null", "no/such", "tests"])
def test_any_path(name):
    for what in (visaug.Camera.load, FrameSet.load, visaug.effects.load_file):
        with pytest.raises((InputError, OSError)):  # the program makes one line of either
            what(name)
