"""Damaged, hostile and oversized frame files: one line, no memory asked for, no wrong pixel."""

import io
import os
import struct
import warnings
import zipfile
import zlib

import numpy as np
import pytest
import tifffile
from astropy.io import fits
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from visaug.augment.image_io.tiff import read_tiff
from visaug.core.errors import InputError
from visaug.frames.headers import frames_of
from visaug.frames.limits import VARIABLE
from visaug.frames.pixels import PixelReader

PIXELS = np.random.default_rng(5).integers(0, 4000, (7, 9)).astype(np.uint16)


def npy(header: str, content: bytes = bytes(200)) -> bytes:
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + content


def npz(*members: tuple[str, bytes], method=zipfile.ZIP_STORED) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", method) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return made.getvalue()


def array(pixels: np.ndarray) -> bytes:
    made = io.BytesIO()
    np.save(made, pixels)
    return made.getvalue()


def refused(tmp_path, name, content, match=None):
    (tmp_path / name.split("#")[0]).write_bytes(content)
    with pytest.raises(InputError, match=match) as error:
        PixelReader(tmp_path).read(name)
    assert "\n" not in str(error.value)


SHAPES = [
    "(-5, 10)",
    "(1000000, 1000000)",
    "(10**11, 10**11)",
    "(100000000000, 100000000000)",
    "(True, 10)",
    "(-1, 1)",
]
SHAPES += ["(0, 5)", "()", "(5,)", "(2, 3, 4, 5)", "(1.5, 2)", "[3, 4]", "None", "((((3,),),),)", "(3, 4"]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("order", ["False", "True", "2"])
def test_headers_that_make_no_sense(tmp_path, shape, order):
    header = f"{{'descr': '<u2', 'fortran_order': {order}, 'shape': {shape}, }}"
    refused(tmp_path, "a.npy", npy(header))
    refused(tmp_path, "a.npz", npz(("a.npy", npy(header))))
    refused(tmp_path, "a.npz", npz(("a.npy", npy(header)), method=zipfile.ZIP_DEFLATED))


@pytest.mark.parametrize("descr", ["'|O'", "'<c8'", "'|V3'", "'<U4'", "[('a', '<u2')]", "'x9'", "17"])
def test_types_that_are_no_pixels(tmp_path, descr):
    refused(tmp_path, "a.npy", npy(f"{{'descr': {descr}, 'fortran_order': False, 'shape': (3, 4), }}"))


def test_an_archive_does_not_lend_the_bytes_of_its_next_member(tmp_path):
    header = "{'descr': '<u2', 'fortran_order': False, 'shape': (20, 10), }"
    content = npz(("a.npy", npy(header, bytes(100))), ("b.npy", array(np.full((40, 40), 77, np.uint16))))
    refused(tmp_path, "a.npz#a", content, "more than it holds")


def test_a_flipped_bit_in_an_archive_is_found(tmp_path):
    content = bytearray(npz(("a.npy", array(PIXELS))))
    (tmp_path / "a.npz").write_bytes(content)
    assert (PixelReader(tmp_path).read("a.npz") == PIXELS).all()
    content[content.index(PIXELS.tobytes()) + 11] ^= 4
    refused(tmp_path, "b.npz", bytes(content), "CRC")


def with_next_page(made: io.BytesIO, place) -> bytes:
    """A TIFF file whose last page names a next one.

    Args:
        place: of the next page, from the places of all pages.
    """
    made.seek(0)
    with tifffile.TiffFile(made) as file:
        places, last, tiff = [page.offset for page in file.pages], file.pages[-1], file.tiff
        end = last.offset + tiff.tagnosize + tiff.tagsize * len(last.tags)
    content = bytearray(made.getvalue())
    struct.pack_into(tiff.offsetformat, content, end, place(places))
    return bytes(content)


@pytest.mark.parametrize("pages", [1, 3])
@pytest.mark.parametrize("back_to", [0, -1])
@pytest.mark.parametrize("kind", [{"bigtiff": False, "byteorder": "<"}, {"bigtiff": True, "byteorder": ">"}])
def test_pages_of_a_tiff_in_a_circle(tmp_path, pages, back_to, kind):
    """The place after the last page is that of an earlier one."""
    made = io.BytesIO()
    with tifffile.TiffWriter(made, **kind) as writer:
        for _ in range(pages):
            writer.write(PIXELS, contiguous=False)
    content = with_next_page(made, lambda places: places[back_to])
    refused(tmp_path, "a.tif", content, "circle")
    refused(tmp_path, "a.tif#[0]", content, "circle")
    with pytest.raises(InputError, match="circle"):
        frames_of(tmp_path / "a.tif")
    with pytest.raises(InputError, match="circle"):
        read_tiff(tmp_path / "a.tif")


@pytest.mark.parametrize("place", [2**63, 2**64 - 1])
def test_a_place_of_a_next_page_beyond_the_file_is_its_end(tmp_path, place):
    made = io.BytesIO()
    tifffile.imwrite(made, PIXELS, bigtiff=True)
    (tmp_path / "a.tif").write_bytes(with_next_page(made, lambda _: place))
    assert (PixelReader(tmp_path).read("a.tif") == PIXELS).all()
    assert read_tiff(tmp_path / "a.tif").pixels.size == PIXELS.size


def test_encrypted_and_unknown_compression(tmp_path):
    content = bytearray(npz(("a.npy", array(PIXELS)), method=zipfile.ZIP_DEFLATED))
    directory = content.index(b"PK\x01\x02")
    encrypted, unknown = content.copy(), content.copy()
    encrypted[6] |= 1
    encrypted[directory + 8] |= 1
    unknown[8] = unknown[directory + 10] = 99
    refused(tmp_path, "a.npz", bytes(encrypted))
    refused(tmp_path, "a.npz", bytes(unknown))


def png_claiming(width, height) -> bytes:
    def chunk(name, content):
        return (
            struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
        )

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")


def tiff_claiming(side) -> bytes:
    made = io.BytesIO()
    tifffile.imwrite(made, PIXELS)
    content = bytearray(made.getvalue())
    with tifffile.TiffFile(io.BytesIO(content)) as file:
        for name in ("ImageWidth", "ImageLength"):
            tag = file.pages.first.tags[name]
            struct.pack_into("<I" if tag.dtype == 4 else "<H", content, tag.valueoffset, side)
    return bytes(content)


def fits_claiming(columns, rows) -> bytes:
    cards = [
        "SIMPLE  =                    T",
        "BITPIX  =                   16",
        "NAXIS   =                    2",
    ]
    cards += [f"NAXIS1  = {columns:>20}", f"NAXIS2  = {rows:>20}", "END"]
    return "".join(card.ljust(80) for card in cards).encode().ljust(2880) + bytes(2880)


def test_pictures_that_claim_more_than_the_limit(tmp_path, monkeypatch):
    refused(tmp_path, "a.tif", tiff_claiming(30_000), VARIABLE)
    refused(tmp_path, "a.png", png_claiming(30_000, 30_000), VARIABLE)
    refused(tmp_path, "a.fits", fits_claiming(30_000, 30_000), VARIABLE)
    refused(tmp_path, "a.fits", fits_claiming(-4, 3))
    refused(
        tmp_path,
        "a.npy",
        npy("{'descr': '<u2', 'fortran_order': False, 'shape': (30000, 30000), }"),
        VARIABLE,
    )

    (tmp_path / "b.npy").write_bytes(array(PIXELS))
    monkeypatch.setenv(VARIABLE, str(PIXELS.size - 1))
    with pytest.raises(InputError, match=VARIABLE):
        PixelReader(tmp_path).read("b.npy")
    monkeypatch.setenv(VARIABLE, str(PIXELS.size))
    assert (PixelReader(tmp_path).read("b.npy") == PIXELS).all()
    monkeypatch.setenv(VARIABLE, "many")
    with pytest.raises(InputError, match=VARIABLE):
        PixelReader(tmp_path).read("b.npy")


def test_pillow_opens_only_the_formats_that_are_meant(tmp_path):
    eps = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 10 10\n%%EndComments\nshowpage\n"
    refused(tmp_path, "a.png", eps)
    made = io.BytesIO()
    Image.fromarray(PIXELS.astype(np.uint8)).save(made, "GIF")
    refused(tmp_path, "a.png", made.getvalue())


@pytest.mark.parametrize(
    "name", ["a.npz#a[" + "1" * 5000 + "]", "x" * 5000 + ".png", "a.npy#[99999999]", "..", "a", "z\0.npy"]
)
def test_names_that_name_no_frame(tmp_path, name):
    (tmp_path / "a.npy").write_bytes(array(PIXELS))
    with pytest.raises(InputError):
        PixelReader(tmp_path).read(name)


def whole(suffix: str) -> bytes:
    made = io.BytesIO()
    if suffix == ".npy":
        return array(PIXELS)
    if suffix == ".npz":
        return npz(("a.npy", array(PIXELS)), method=zipfile.ZIP_DEFLATED)
    if suffix == ".tif":
        tifffile.imwrite(made, PIXELS, compression="zlib")
    elif suffix == ".fits":
        fits.PrimaryHDU(PIXELS).writeto(made)
    else:
        Image.fromarray(PIXELS if suffix == ".png" else PIXELS.astype(np.uint8)).save(
            made, {".png": "PNG", ".jpg": "JPEG", ".bmp": "BMP", ".pgm": "PPM"}[suffix]
        )
    return made.getvalue()


WHOLE = {
    suffix: whole(suffix) for suffix in (".npy", ".npz", ".tif", ".fits", ".png", ".jpg", ".bmp", ".pgm")
}


@settings(
    max_examples=int(os.environ.get("VISAUG_EXAMPLES", "300")),
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
@given(data=st.data())
def test_any_damage_reads_as_pixels_or_is_refused(tmp_path_factory, data):
    suffix = data.draw(st.sampled_from(sorted(WHOLE)))
    content = bytearray(WHOLE[suffix])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content) - 1)) if content else 0
        match data.draw(st.sampled_from(["set", "cut", "insert"])):
            case "set" if content:
                content[at] = data.draw(st.integers(0, 255))
            case "cut":
                del content[at : at + data.draw(st.integers(1, 400))]
            case "insert":
                content[at:at] = data.draw(st.binary(max_size=20))
    folder = tmp_path_factory.getbasetemp()
    (folder / f"damaged{suffix}").write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            pixels = PixelReader(folder).read(f"damaged{suffix}")
        except InputError:
            return
    assert pixels.ndim == 2
