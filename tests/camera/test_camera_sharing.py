"""The user's own cameras: added, known by name, exported; refused where a figure has no source."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from astropy.io import fits

from visaug.app.cli.root import main
from visaug.camera import Camera
from visaug.camera.sharing import add_camera, documented, export_camera
from visaug.core.errors import InputError

CONTENT = {
    "name": "Lab camera 7",
    "resolution": [24, 32],
    "bit_depth": 12,
    "gain_e_per_dn": 2.5,
    "read_noise": {"sigma_e": 4.0, "shape": 0.14},
    "effects": [{"name": "row_noise", "sigma_e": 1.5}],
    "source": {
        "resolution": "manual",
        "bit_depth": "manual",
        "gain_e_per_dn": "photon transfer",
        "read_noise": "bias frames",
    },
    "assumed": ["row_noise.sigma_e"],
    "licence": "CC0",
}


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "camera.yaml").write_text("# my comment\n" + yaml.safe_dump(CONTENT))
    return tmp_path / "camera.yaml"


def changed(file: Path, **keys: object) -> Path:
    file.write_text(yaml.safe_dump({**CONTENT, **keys}))
    return file


def test_an_added_camera_is_known_by_its_name(file: Path, capsys: pytest.CaptureFixture) -> None:
    main(["cameras", "add", "camera.yaml"])
    assert Camera.load("lab_camera_7").spec.gain_e_per_dn == 2.5
    assert Camera.load("Lab Camera-7").effect_names == ["row_noise"]
    main(["cameras"])
    line = next(row for row in capsys.readouterr().out.splitlines() if "Lab camera 7" in row)
    assert "yours" in line
    kept = file.parent / "data/visaug/cameras/lab_camera_7.yaml"
    assert kept.read_text() == file.read_text()  # comments too


def test_it_is_not_overwritten_unasked(file: Path) -> None:
    add_camera(file)
    changed(file, gain_e_per_dn=3.0)
    with pytest.raises(InputError, match="already exists"):
        add_camera(file)
    assert Camera.load("lab_camera_7").spec.gain_e_per_dn == 2.5
    add_camera(file, force=True)
    assert Camera.load("lab_camera_7").spec.gain_e_per_dn == 3.0


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"source": "a datasheet"}, "source of each figure"),
        ({"source": {**CONTENT["source"], "bit_depth": " "}}, "source.bit_depth"),
        ({"assumed": []}, "row_noise.sigma_e has neither"),
        ({"assumed": ["row_noise.sigma_e", "bit_depth"]}, "bit_depth has a source too"),
        ({"assumed": ["row_noise.sigma_e", "prnu.pixel"]}, "prnu.pixel is no figure"),
        ({"name": "sony imx174"}, "camera in the package"),
        ({"name": "???"}, "name"),
        ({"gain_e_per_dn": -1}, "gain_e_per_dn"),
    ],
)
def test_an_undocumented_camera_is_refused(file: Path, keys: dict, said: str) -> None:
    with pytest.raises(InputError, match=said):
        add_camera(changed(file, **keys))
    assert not (file.parent / "data").exists()


@pytest.mark.parametrize("name", ["dsnu.npy", "maps.npz#dark", "maps.npz#darks[1]", "dsnu.fits.gz"])
def test_maps_go_along(file: Path, name: str) -> None:
    """The added camera still loads its map once the original is gone."""
    pattern = np.arange(24 * 32, dtype=np.float32).reshape(24, 32) / 1000
    original = file.parent / name.partition("#")[0]
    if original.suffix == ".npy":
        np.save(original, pattern)
    elif original.suffix == ".npz":
        np.savez(original, dark=pattern, darks=np.stack([0 * pattern, pattern]))
    else:
        fits.PrimaryHDU(pattern).writeto(original)
    changed(file, dsnu={"map": name}, source={**CONTENT["source"], "dsnu": "40 dark frames"})
    add_camera(file)
    original.unlink()
    np.testing.assert_array_equal(Camera.load("lab_camera_7").maps["dsnu"].numpy(), pattern)
    export_camera("lab_camera_7", "out")
    np.testing.assert_array_equal(Camera.load("out/lab_camera_7.yaml").maps["dsnu"].numpy(), pattern)


def test_export_says_where_every_figure_is_from(file: Path) -> None:
    add_camera(file)
    folder = export_camera("lab_camera_7")
    page = (folder / "README.md").read_text()
    assert "| read_noise.sigma_e | 4.0 | bias frames |" in page
    assert "| row_noise.sigma_e | 1.5 | assumed |" in page
    assert documented(folder / "lab_camera_7.yaml").spec.licence == "CC0"
    with pytest.raises(InputError):  # nothing is overwritten
        export_camera("lab_camera_7")


def test_export_demands_a_licence(file: Path) -> None:
    with pytest.raises(InputError, match="licence"):
        export_camera(changed(file, licence=None))
    assert not Path("camera-camera").exists()


def test_a_folder_is_not_a_camera_file(file: Path) -> None:
    with pytest.raises(InputError, match="is a folder"):
        add_camera(file.parent)
