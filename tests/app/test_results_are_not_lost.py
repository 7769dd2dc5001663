"""Files that visaug did not write stay, unless `--force` is given."""

import json

import numpy as np
import pytest

from visaug.app.cli import main
from visaug.frames import FrameRecord, FrameSet


@pytest.fixture
def frames(tmp_path):
    rng = np.random.default_rng(0)
    records = [FrameRecord(i, f"{i}", "bias", 0.0) for i in range(4)]
    FrameSet.from_arrays(records, rng.normal(100, 4, (4, 24, 32)).round().astype(np.uint16)).save(
        tmp_path / "frames"
    )
    return tmp_path / "frames"


@pytest.mark.parametrize("command", ["characterize", "inspect"])
@pytest.mark.parametrize("option", ["--json", "--report"])
def test_a_foreign_file_is_replaced_with_force_alone(tmp_path, frames, capsys, command, option):
    """The command's own result is made anew without it, and every file made is said."""
    place = tmp_path / ("r.json" if option == "--json" else "r.html")
    place.write_text(json.dumps({"notes": "mine"}))
    told = [command, str(frames), option, str(place)]
    with pytest.raises(SystemExit) as left:
        main(told)
    assert left.value.code == 2
    assert str(place) in capsys.readouterr().err
    assert json.loads(place.read_text()) == {"notes": "mine"}
    main([*told, "--force"])
    assert f"wrote {place}" in capsys.readouterr().out
    main(told)
    assert f"wrote {place}" in capsys.readouterr().out


def test_defects_and_maps_of_others_stay(tmp_path, frames, capsys):
    """A list of defects is made anew; of a map nothing tells whose it is."""
    mine = tmp_path / "mine.csv"
    mine.write_text("row,column\n1,2\n")
    (tmp_path / "maps").mkdir()
    dark = tmp_path / "maps" / "master_bias.fits"
    dark.write_text("mine")
    for words, place in (
        (["inspect", str(frames), "--defects", str(mine)], mine),
        (["characterize", str(frames), "--maps", str(dark.parent)], dark),
    ):
        before = place.read_bytes()
        with pytest.raises(SystemExit) as left:
            main(words)
        assert left.value.code == 2
        assert str(place) in capsys.readouterr().err
        assert place.read_bytes() == before
        main([*words, "--force"])
        assert place.read_bytes() != before
    main(["inspect", str(frames), "--defects", str(mine)])


def test_pictures_of_others_beside_a_report_stay(tmp_path, frames, capsys):
    """A comparison writes pictures into a folder beside its page, and makes its own anew."""
    camera, report = tmp_path / "camera.yaml", tmp_path / "r.html"
    camera.write_text("{resolution: [24, 32], bit_depth: 8, gain_e_per_dn: 1, read_noise: {sigma_e: 4}}")
    mine = tmp_path / "r_pictures" / "level.svg"
    mine.parent.mkdir()
    mine.write_text("<svg>mine</svg>")
    words = ["compare", str(frames), "--camera", str(camera), "--report", str(report), "-q"]
    with pytest.raises(SystemExit) as left:
        main(words)
    assert left.value.code == 2
    assert f"{mine}: exists, and visaug did not write it" in capsys.readouterr().err
    assert mine.read_text() == "<svg>mine</svg>"
    assert not report.exists()
    main([*words, "--force"])
    main(words)
    assert mine.read_text() != "<svg>mine</svg>"


def test_the_demonstration_replaces_no_report_of_others(tmp_path, capsys):
    (tmp_path / "report.html").write_text("mine")
    with pytest.raises(SystemExit) as left:
        main(["demo", "-o", str(tmp_path)])
    assert left.value.code == 2
    assert "report.html: exists, and visaug did not write it; expected another folder" in (
        capsys.readouterr().err
    )
    assert [file.name for file in tmp_path.iterdir()] == ["report.html"]


def test_what_was_measured_is_written_where_there_is_no_camera(tmp_path, frames, capsys):
    """Dark frames alone tell no gain, of which the last line speaks."""
    files = {name: tmp_path / name for name in ("c.yaml", "r.html", "r.json", "s.html", "maps")}
    words = ["-o", "c.yaml", "--report", "r.html", "--json", "r.json", "--sheet", "s.html", "--maps", "maps"]
    with pytest.raises(SystemExit) as left:
        main(["characterize", str(frames), *(str(files.get(word, word)) for word in words)])
    assert left.value.code == 2
    said = capsys.readouterr()
    assert "the frames do not tell the gain" in said.err.splitlines()[-1]
    assert sorted(name for name, file in files.items() if file.exists()) == [
        "maps",
        "r.html",
        "r.json",
        "s.html",
    ]
    assert "Next" not in said.err


def test_one_frame_of_which_nothing_is_measured_has_a_report(tmp_path, frames, capsys):
    """And no maps, which is said."""
    one = tmp_path / "one.csv"
    one.write_text("file,kind\nframes/frames.npz#frames[0],bias\n")
    report, maps = tmp_path / "r.html", tmp_path / "maps"
    main(["characterize", str(one), "--report", str(report), "--maps", str(maps)])
    said = capsys.readouterr()
    assert "no map is written" in said.err
    assert f"wrote {maps}" not in said.out
    assert not maps.exists()
    assert "two or more bias frames" in report.read_text()


@pytest.mark.parametrize("option", [["--method", "paper"], ["--maps", "maps"], ["--sheet", "s.html"]])
def test_options_that_pictures_cannot_answer_are_refused(tmp_path, monkeypatch, capsys, option):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "photos").mkdir()
    for i in range(2):
        np.save(tmp_path / "photos" / f"p{i}.npy", np.zeros((24, 32), np.uint8))
    with pytest.raises(SystemExit) as left:
        main(["characterize", "photos", *option])
    assert left.value.code == 2
    assert f"{option[0]}: FRAMES are ordinary pictures" in capsys.readouterr().err


def test_a_report_names_the_next_command_with_the_camera_that_was_given(tmp_path, frames):
    camera, report = tmp_path / "camera.yaml", tmp_path / "r.html"
    camera.write_text("{resolution: [24, 32], bit_depth: 8, gain_e_per_dn: 1, read_noise: {sigma_e: 4}}")
    main(["characterize", str(frames), "--camera", str(camera), "--report", str(report), "-q"])
    assert f"visaug characterize {frames} --camera {camera}" in report.read_text()
