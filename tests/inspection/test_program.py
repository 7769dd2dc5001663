"""The command and the kinds of frames: a folder of dark frames with banding, column offsets and a hot pixel."""

import json

import numpy as np
import pytest
import tifffile
from PIL import Image

import visaug
from tests.inspection.cameras import SHAPE, camera, frames
from visaug.app.cli import main
from visaug.frames import FrameRecord, FrameSet


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(3)
    patterns, _ = camera("banding and columns", rng, 8)
    values = frames(rng, patterns, 8, 12, black=100)
    values[:, 40, 77] += 600
    (tmp_path / "frames").mkdir()
    for k, frame in enumerate(values):
        Image.fromarray(frame).save(tmp_path / "frames" / f"dark_{k:02d}.png")
    return tmp_path / "frames"


def test_the_first_line_is_the_answer(folder, tmp_path, capsys):
    report, table, defects = (tmp_path / name for name in ("r.html", "r.json", "d.csv"))
    main(["inspect", str(folder), "--report", str(report), "--json", str(table), "--defects", str(defects)])
    said = capsys.readouterr()
    first = said.out.splitlines()[0]
    assert first == (
        "row banding of 13 rows, 2.5 DN, new phase in each frame; column offsets of 1.5 DN, fixed; 1 hot pixel"
    )
    content = json.loads(table.read_text())
    assert (content["schema"], content["answer"], content["frames"]) == (1, first, 8)
    assert content["kinds"] == {"dark": 8}
    assert [f["what"] for f in content["findings"]] == ["row_banding", "column_offset", "hot_pixels"]
    keys = {"what", "kind", "amplitude_dn", "low", "high", "period", "share", "text"}
    assert all(keys <= set(f) for f in content["findings"])
    assert content["next"] in said.err
    assert defects.read_text().splitlines()[1].startswith("40,77,hot,")
    page = report.read_text()
    assert page.count("<figure") == 3
    assert content["answer"][1:] in page


def test_json_on_standard_output_is_json_alone(folder, capsys):
    main(["inspect", str(folder), "--json", "-"])
    assert json.loads(capsys.readouterr().out)["findings"]


def test_characterize_takes_them_for_dark_frames(folder):
    result = visaug.characterize(folder)
    assert result["black_level_dn"].value == pytest.approx(100, abs=0.3)
    assert {r.kind for r in visaug.FrameSet.load(folder).records} == {"dark"}
    assert any(w.startswith("exposure_unknown") for w in result.to_json()["warnings"])
    assert "dark_current.a_e_per_s" not in result.parameters


def test_pictures_named_dark_stay_pictures(tmp_path):
    """Names alone do not make dark frames: these show a scene."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    scene = 120 + 60 * np.sin(x / 9.0) * np.cos(y / 7.0)
    for k in range(3):
        noise = np.random.default_rng(k).normal(0, 2, SHAPE)
        Image.fromarray(np.rint(scene + noise).astype(np.uint8)).save(tmp_path / f"dark_{k}.png")
    assert visaug.FrameSet.load(tmp_path).is_pictures


def test_darks_and_flats_without_exposures_can_be_inspected(tmp_path):
    """A measurement refuses them for lack of exposures; to look at them needs none. A stack in one file is read too."""
    rng = np.random.default_rng(5)
    for name, level in (("dark", 40), ("flat", 150)):
        for k in range(3):
            Image.fromarray(frames(rng, [], 1, 8, black=level)[0]).save(tmp_path / f"{name}_{k}.png")
    with pytest.raises(visaug.InputError, match="exposure_s"):
        visaug.FrameSet.load(tmp_path)
    assert visaug.inspect(tmp_path).kinds == {"dark": 3, "flat": 3}
    np.save(tmp_path / "stack.npy", frames(rng, [], 4, 12))
    assert visaug.inspect(tmp_path / "stack.npy").kinds == {"dark": 4}


def test_a_users_mistake_is_one_line(tmp_path, capsys):
    with pytest.raises(SystemExit) as end:
        main(["inspect", str(tmp_path / "nothing")])
    assert end.value.code == 2
    assert "no such file or folder" in capsys.readouterr().err


def test_two_outputs_of_one_name_are_refused(folder, tmp_path, capsys):
    """One of them would be lost."""
    same = str(tmp_path / "same.json")
    with pytest.raises(SystemExit, match="2"):
        main(["inspect", str(folder), "--json", same, "--report", same])
    said = capsys.readouterr().err
    assert "--json" in said
    assert "--report" in said
    assert "same file" in said
    main(["inspect", str(folder), "--json", "-", "--report", str(tmp_path / "r.html")])


def test_the_next_command_for_one_stack_is_of_its_folder(tmp_path):
    rng = np.random.default_rng(5)
    np.save(tmp_path / "stack.npy", np.rint(rng.normal(100, 3, (6, *SHAPE))).astype(np.uint8))
    words = visaug.inspect(tmp_path / "stack.npy").to_json()["next"].split()
    assert words == ["visaug", "frames", str(tmp_path), "-o", str(tmp_path / "frames.csv")]


def test_the_colours_of_a_stated_mosaic_are_no_pattern_of_the_sensor():
    """Red and blue answer to half the light of green; a fixed offset of odd columns is found in dark frames all the same."""
    rng = np.random.default_rng(6)
    light = np.tile([[0.5, 1.0], [1.0, 0.5]], (SHAPE[0] // 2, SHAPE[1] // 2))
    odd = 6.0 * (np.arange(SHAPE[1]) % 2)  # 3 DN either way
    pixels = [rng.normal(100 + odd, 3, SHAPE) for _ in range(6)]
    pixels += [rng.normal(100 + odd + 800 * light, 10, SHAPE) for _ in range(6)]
    records = [
        FrameRecord(k, str(k), "dark" if k < 6 else "flat", exposure_s=0.1, bayer="RGGB") for k in range(12)
    ]
    found = visaug.inspect(FrameSet.from_arrays(records, np.rint(pixels).astype(np.uint16)))
    (parity,) = (f for f in found.findings if f.what == "parity")
    assert parity.amplitude_dn == pytest.approx(3, rel=0.1)
    assert any("RGGB" in note for note in found.notes)


def test_one_frame_is_said_as_one_and_a_table_as_a_table(folder, tmp_path, capsys):
    main(["inspect", str(folder / "dark_00.png")])
    said = capsys.readouterr().out
    assert "\n1 frame, kinds by the file names; " in said
    assert "\n1 dark frame: level " in said
    main(["frames", str(folder), "-o", str(folder / "frames.csv"), "--exposure", "1"])
    assert visaug.inspect(folder).kinds_from == "the table or headers"
    assert visaug.inspect(folder / "frames.csv").kinds_from == "the table or headers"


@pytest.mark.parametrize("name", ["dark.npy", "dark_stack.tif", "a.npz"])
def test_stacks_are_looked_at_and_the_next_command_runs(tmp_path, name, capsys):
    """A measuring command does not read a stack without a table, whose name tells the kind though."""
    values = np.rint(np.random.default_rng(5).normal(100, 3, (6, 24, 32))).astype(np.uint16)
    place = tmp_path / name
    if name.endswith(".npy"):
        np.save(place, values)
    elif name.endswith(".npz"):
        np.savez(place, dark=values)
    else:
        tifffile.imwrite(place, values, photometric="minisblack")
    for path in (place, tmp_path):
        result = visaug.inspect(path)
        assert result.kinds == {"dark": 6}
        assert result.next_command == f"visaug frames {tmp_path} -o {tmp_path}/frames.csv"
    main(result.next_command.split()[1:])
    assert f"wrote {tmp_path}/frames.csv" in capsys.readouterr().out
