"""TIFF files of three samples a pixel that a table names: colours, or frames that a writer took for colours."""

import numpy as np
import pytest

from visaug import FrameSet, InputError

tifffile = pytest.importorskip("tifffile")
PLANES = np.stack([np.full((16, 20), level, np.uint16) for level in (100, 200, 300)])


def table(folder, names: list[str]) -> FrameSet:
    rows = "".join(f'{i},"{name}",bias,0.001,20\n' for i, name in enumerate(names))
    (folder / "frames.csv").write_text(f"sequence,file,kind,exposure_s,temperature_c\n{rows}")
    return FrameSet.load(folder)


@pytest.mark.parametrize("are_last", [False, True])
def test_of_colours_green_is_read_and_said(tmp_path, are_last):
    pixels = np.moveaxis(PLANES, 0, -1) if are_last else PLANES
    tifffile.imwrite(tmp_path / "a.tif", np.ascontiguousarray(pixels), photometric="rgb")
    frames = table(tmp_path, ["a.tif"])
    assert frames.read(0).max() == 200
    (said,) = frames.warnings
    assert said.startswith("colour_planes: a.tif of several samples a pixel")
    assert "a.tif#[0]" in said


def test_one_file_of_colours_among_gray_ones_is_said(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", PLANES[0])
    tifffile.imwrite(tmp_path / "b.tif", PLANES, photometric="rgb")
    (said,) = table(tmp_path, ["a.tif", "b.tif"]).warnings
    assert said.startswith("colour_planes: b.tif of")


def test_planes_that_the_table_names_are_frames(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", PLANES, photometric="rgb")
    frames = table(tmp_path, [f"a.tif#[{i}]" for i in range(3)])
    assert [int(frames.read(i).mean()) for i in range(3)] == [100, 200, 300]
    assert frames.warnings == []
    with pytest.raises(InputError, match=r"index \[3\] is outside shape"):
        table(tmp_path, ["a.tif#[3]"]).read(0)


def test_pages_are_frames_and_nothing_is_said(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", PLANES, photometric="minisblack")
    frames = table(tmp_path, [f"a.tif#[{i}]" for i in range(3)])
    assert [int(frames.read(i).mean()) for i in range(3)] == [100, 200, 300]
    assert frames.warnings == []


def test_a_stack_of_colour_pictures_has_green_frames_and_planes(tmp_path):
    pixels = np.stack([np.moveaxis(PLANES, 0, -1) + n for n in range(2)])
    tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="rgb")
    frames = table(tmp_path, ["a.tif#[0]", "a.tif#[1]", "a.tif#[1,2]"])
    assert [int(frames.read(i).mean()) for i in range(3)] == [200, 201, 301]


def test_transparency_is_no_frame(tmp_path):
    pixels = np.moveaxis(np.concatenate([PLANES, PLANES[:1]]), 0, -1)
    tifffile.imwrite(
        tmp_path / "a.tif", np.ascontiguousarray(pixels), photometric="rgb", extrasamples=["unassalpha"]
    )
    assert table(tmp_path, ["a.tif"]).read(0).max() == 200
    with pytest.raises(InputError, match="expected one frame"):
        table(tmp_path, ["a.tif#[3]"]).read(0)
