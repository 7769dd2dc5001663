"""The pages of the measuring commands, on small frames and answers written here."""

import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import visaug
from visaug.frames import FrameRecord, FrameSet
from visaug.report.headline import COUNTED, diagnosis_details, verdict_row, verdict_rows
from visaug.report.pages import write_comparison, write_diagnosis
from visaug.report.plots.error import plot_error_steps, plot_ranking
from visaug.report.plots.view import plot_view

CAMERA = {
    "name": "plain",
    "resolution": [32, 40],
    "bit_depth": 12,
    "gain_e_per_dn": 2.0,
    "quantum_efficiency": 0.5,
    "black_level_dn": 100,
    "read_noise": {"sigma_e": 8.0},
    "dsnu": {"column_e": 2.0},
}
WHERE = [{"view": "temporal_lines", "share": 0.7, "worst": "rows, bias", "z": 14.2}]
DIAGNOSIS = {
    "schema": 1,
    "error": {"before": 1.0, "after": 0.04, "floor": 0.0, "interval_after": [-0.02, 0.09]},
    "fits": {
        "p_value_before": 0.003,
        "p_value_after": 0.41,
        "adequate_before": False,
        "adequate_after": True,
    },
    "where": WHERE,
    "ranking": [
        {
            "effect": "row_noise",
            "probability": 0.98,
            "error_after": 0.04,
            "parameters": {"sigma_e": {"value": 1.19, "low": 1.1, "high": 1.3}},
        },
        {"effect": "smear", "probability": 0.01, "error_after": None, "parameters": {}},
    ],
    "accepted": ["row_noise"],
    "steps": [
        {"action": "refit", "error": 0.83, "interval": [0.8, 0.86]},
        {"action": "add row_noise", "error": 0.04, "interval": [-0.02, 0.09]},
    ],
    "frames": {"fit": [0], "select": [1], "confirm": [2]},
    "ambiguous": [{"effects": ["a", "b"], "measure": "darks at two temperatures"}],
    "unexplained": {
        "description": "Something grows with the signal.",
        "axis": ["row"],
        "grows_with": ["signal"],
    },
}
NOTHING = {
    **DIAGNOSIS,
    "error": {"before": None, "after": None, "floor": 0.0, "interval_after": None},
    "fits": {"p_value_before": 0.4, "p_value_after": 0.4, "adequate_before": True, "adequate_after": True},
    "where": [],
    "ranking": [],
    "accepted": [],
    "steps": [{"action": "refit", "error": None, "interval": None}],
    "ambiguous": [],
    "unexplained": None,
}


@dataclass
class Answer:
    """Stands for a result: what the pages ask of one."""

    content: dict
    camera: visaug.Camera

    def to_json(self):
        return self.content


@pytest.fixture(scope="module")
def camera():
    return visaug.Camera.load(CAMERA)


@pytest.fixture(scope="module")
def frames(camera):
    plan = [FrameRecord(i, f"{i}.npy", "bias") for i in range(8)]
    plan += [
        FrameRecord(8 + i, f"{8 + i}.npy", "flat", 0.01, photons=500.0 * (1 + i // 4)) for i in range(12)
    ]
    empty = FrameSet.from_arrays(plan, [np.zeros((32, 40), np.uint16)] * len(plan), bit_depth=12)
    return visaug.simulate(camera, empty, seed=1)


def text_of(path) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>|data:[^\"]*", " ", path.read_text()))


def test_diagnosis_page_tells_the_answer(camera, frames, tmp_path):
    better = camera.with_effect("row_noise", sigma_e=1.2)
    path = write_diagnosis(tmp_path / "d.html", Answer(DIAGNOSIS, better), camera, frames)
    text = text_of(path)
    for piece in (
        "row_noise",
        "0.04",
        "1.19",
        "[1.10, 1.30]",
        "Something grows",
        "two temperatures",
        "8 bias, 12 flat",
        COUNTED,
    ):
        assert piece in text
    # the error falling, the ranking, and the worst view, before and after in one picture
    assert path.read_text().count("<img") == 3


def test_the_count_beside_a_probability_stands_in_the_documentation():
    results = Path(__file__).resolve().parents[2] / "docs" / "results.md"
    assert COUNTED in " ".join(results.read_text().split())


def test_diagnosis_page_of_a_camera_that_holds(camera, frames, tmp_path):
    path = write_diagnosis(tmp_path / "d.html", Answer(NOTHING, camera), camera, frames)
    assert "Nothing is missing" in text_of(path)
    assert "<img" not in path.read_text()


def test_comparison_page_gives_its_pictures_as_files(camera, frames, tmp_path):
    pictures = write_comparison(tmp_path / "c.html", Answer(DIAGNOSIS, camera), camera, frames)
    assert {"temporal_lines", "photon_transfer", "fixed_pattern"} <= set(pictures)
    for path in pictures.values():
        assert path.parent == tmp_path / "c_pictures"
        if path.suffix == ".png":
            assert min(Image.open(path).size) > 100
        else:
            assert path.read_text().rstrip().endswith("</svg>")
    assert "does not hold" in text_of(tmp_path / "c.html")
    assert json.dumps({name: str(path) for name, path in pictures.items()})


def test_error_steps_show_every_known_step_and_its_interval():
    axes = plot_error_steps(DIAGNOSIS["steps"], 1.0, 0.0).axes[0]
    line = next(line for line in axes.lines if line.get_marker() == "o")
    assert list(line.get_ydata()) == [1.0, 0.83, 0.04]
    ends = [list(line.get_ydata()) for line in axes.lines]
    assert [0.8, 0.86] in ends
    assert [-0.02, 0.09] in ends
    assert axes.get_ylabel()


def test_ranking_leaves_out_what_has_no_error():
    axes = plot_ranking(DIAGNOSIS["ranking"]).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["row_noise"]


def test_every_view_is_drawn_measured_beside_modelled(frames):
    from visaug.statistics import VIEWS, FrameData

    data = FrameData(frames)
    drawn = 0
    for view in VIEWS:
        picture = view.picture(data)
        if picture is None:
            continue
        figure = plot_view(picture, picture)
        figure.canvas.draw()
        drawn += 1
        if picture.curves:
            axes = figure.axes[0]
            assert sum(len(panel.lines) for panel in figure.axes) == 2 * len(picture.curves), view.name
            assert axes.get_xlabel(), view.name
            assert axes.get_ylabel(), view.name
    assert drawn >= 5


def test_a_limit_of_a_parameter_that_an_effect_makes_smaller_is_a_lower_one():
    """Heavier tails have a smaller shape: absent means that the shape lies above the limit."""
    absent = {"verdict": "absent", "from": None, "frames": None}
    tails = {"effect": "read_noise", "parameter": "read_noise.shape", "unit": "1", "limit": 0.02}
    rows = {"effect": "row_noise", "parameter": "row_noise.sigma_e", "unit": "e-", "limit": 0.3}
    assert verdict_row(absent | tails)[2] == "shape > 0.02"
    assert verdict_row(absent | rows)[2] == "sigma_e < 0.3 e-"


@pytest.mark.parametrize(
    ("adequate", "after", "interval", "said"),
    [
        (True, 0.04, [-0.02, 0.09], "After adding, no significant difference is left"),
        (True, 0.94, [0.92, 0.97], "most of the error stays: it is not shown to be the cause"),
        (False, 0.94, [0.92, 0.97], "After adding, a significant difference is left"),
    ],
)
def test_an_effect_with_which_most_of_the_error_stays_does_not_pass_for_the_cause(
    adequate, after, interval, said
):
    """A dead pixel more or less deviates so far that no largest deviation is significant."""
    content = {
        **DIAGNOSIS,
        "error": {**DIAGNOSIS["error"], "after": after, "interval_after": interval},
        "fits": {**DIAGNOSIS["fits"], "adequate_after": adequate},
    }
    lines = [line for line in diagnosis_details(content) if line.startswith("After adding")]
    assert len(lines) == 1
    assert said in lines[0]


def test_what_is_named_comes_first_in_the_table_of_verdicts():
    entry = {
        "parameter": None,
        "unit": None,
        "value": None,
        "low": None,
        "limit": None,
        "from": None,
        "frames": None,
    }
    effects = [
        entry | {"effect": name, "verdict": verdict}
        for name, verdict in (
            ("a", "absent"),
            ("b", "not testable"),
            ("c", "named"),
            ("d", "absent"),
            ("e", "not separable"),
        )
    ]
    assert [row[0] for row in verdict_rows(effects)] == ["c", "e", "b", "a", "d"]
