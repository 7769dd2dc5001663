"""Pictures beside pictures of cameras in plain NumPy, with scenes of different kinds."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from benchmark import pictures as independent
from visaug.app.cli import main
from visaug.core.errors import InputError
from visaug.frames import FrameRecord, FrameSet
from visaug.pictures.comparison import compare_pictures

CAMERA = independent.PictureCamera("one", 16.0, 28.0, black_dn=10.0)


def taken(content, seed, camera=CAMERA, n=16):
    rng = np.random.default_rng(seed)
    scenes = [getattr(independent, content)(rng, (144, 160)) for _ in range(n)]
    return independent.take(camera, scenes, seed)


def in_memory(pictures):
    return FrameSet.from_arrays([FrameRecord(i, f"{i}.png", "image") for i in range(len(pictures))], pictures)


@pytest.fixture(scope="module")
def lightbox():
    return in_memory(taken("spacecraft", 1))


def test_other_scenes_of_one_camera_agree(lightbox):
    """At a fixed seed; the false-alarm rate is 2 %."""
    result = compare_pictures(in_memory(taken("natural", 2)), lightbox)
    assert result.adequate, result.differences(3)
    assert result.where == ()
    views = {d.view for d in result.all_differences}
    assert views >= {
        "noise_level",
        "picture_lines",
        "recurring_pattern",
        "noise_spectrum",
        "blocking",
        "edges",
    }


def patches(rng, blur):
    image = np.full((120, 160), rng.uniform(0.08, 0.5))
    for _ in range(12):
        row, column = rng.integers(0, 100), rng.integers(0, 140)
        height, width = rng.integers(20, 60, 2)
        image[row : row + height, column : column + width] = rng.uniform(0.05, 0.8)
    return ndimage.gaussian_filter(image, blur)


def bodies(rng, blur):
    image = np.zeros((120, 160))
    row, column = rng.integers(10, 50), rng.integers(10, 80)
    image[row : row + 50, column : column + 60] = rng.uniform(0.2, 0.8)
    image[row : row + 25, column : column + 30] *= 0.6
    return ndimage.gaussian_filter(image, blur)


def slopes_apart(one, other, seed):
    """The difference of the view `edges` in standard errors: two scenes behind lenses of a blur (px) each."""
    sides = []
    for k, (scene, blur) in enumerate((one, other)):
        rng = np.random.default_rng([seed, k])
        electrons = [
            rng.poisson(4000 * light) + rng.normal(0, 20, light.shape)
            for light in (scene(rng, blur) for _ in range(20))
        ]
        sides.append(
            in_memory(np.clip(np.rint(np.stack(electrons) * 245 / 4000 + 10), 0, 255).astype(np.uint8))
        )
    [found] = [d for d in compare_pictures(*sides).all_differences if d.view == "edges"]
    return abs(found.z)


def test_slopes_of_edges_do_not_depend_on_the_scene():
    """One lens before patches and bodies; the allowance is far wider than chance, which moves six pairs by a tenth of it."""
    assert max(slopes_apart((patches, 0.8), (bodies, 0.8), seed) for seed in range(6)) < 2
    assert slopes_apart((patches, 0.8), (bodies, 1.3), 7) > 4


@pytest.mark.parametrize(
    ("change", "view"),
    [
        ({"row_e": 20.0}, "picture_lines"),
        ({"column_fixed_e": 20.0}, "recurring_pattern"),
        ({"read_e": 45.0}, "noise_level"),
    ],
)
def test_what_the_target_has_more_of_is_named(lightbox, change, view):
    other = in_memory(taken("spacecraft", 3, replace(CAMERA, **change)))
    result = compare_pictures(lightbox, other)
    assert not result.adequate
    assert view in [place.view for place in result.where]
    worst = next(place for place in result.where if place.view == view)
    assert worst.z > 0


def test_renders_with_the_right_camera_agree_and_without_do_not(tmp_path, capsys):
    rng = np.random.default_rng(5)
    renders = [np.rint(255 * independent.spacecraft(rng, (144, 160))).astype(np.uint8) for _ in range(16)]
    paths = (
        independent.save(renders, tmp_path / "renders"),
        independent.save(taken("spacecraft", 6), tmp_path / "target"),
    )
    camera = tmp_path / "camera.yaml"
    camera.write_text(
        "resolution: [144, 160]\nbit_depth: 8\ngain_e_per_dn: 16.0\nblack_level_dn: 10\nread_noise: {sigma_e: 28.0}\n"
    )
    for extra, agrees in (([], False), (["--camera", str(camera)], True)):
        words = [
            "compare",
            str(paths[0]),
            "--target",
            str(paths[1]),
            *extra,
            "--json",
            str(tmp_path / "c.json"),
        ]
        main([*words, "--report", str(tmp_path / "r.html")])
        assert json.loads((tmp_path / "c.json").read_text())["fits"]["adequate"] is agrees
    assert "the two sets agree" in capsys.readouterr().out.lower()
    assert (tmp_path / "r.html").stat().st_size > 10_000


def test_too_few_pictures_are_refused(lightbox):
    with pytest.raises(InputError, match="5 or more of one size"):
        compare_pictures(lightbox.subset([0, 1]), lightbox)
