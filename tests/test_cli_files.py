"""Pictures that come in and folders that go out: whole, bounded, or refused in one line."""

import errno
import io
import json
import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageOps

from fusionnet.apps.output_folder import RESULT_FILE, RESULT_KIND, check_writable, written_whole
from fusionnet.apps.views import RoomsConfig, rooms
from fusionnet.errors import InputError, OutputError
from fusionnet.files import check_file, write_whole
from fusionnet.views.importing import ImportedViews
from fusionnet.views.picture_file import read_picture


def png_header(width: int, height: int) -> bytes:
    """The beginning of a PNG that claims a size, and holds hardly any data."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = zlib.compress(b"\0" * 1000)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")
    )


def encoded(size: tuple[int, int], form: str = "png", **options) -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", size, (10, 200, 30)).save(buffer, form, **options)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is not a picture"),
        (b"hello", "is not a picture"),
        (b"%PDF-1.7 ...", "is not a picture"),
        (encoded((1, 1)), "is too small, 1 x 1"),
        (encoded((200, 20)), "is too small, 200 x 20"),
        (png_header(20_000, 20_000), "is too large"),
        (png_header(9_000, 9_000), "is too large, 9000 x 9000"),
        (encoded((300, 300))[:-60], "is damaged"),
        (encoded((300, 300), "jpeg")[:-300], "is damaged"),
    ],
)
def test_bad_pictures_are_refused(content, message, tmp_path) -> None:
    file = tmp_path / "picture.png"
    file.write_bytes(content)
    with pytest.raises(InputError, match=f"^(The picture )?{file} {message}"):
        read_picture(file)


def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path, monkeypatch) -> None:
    def unpack(*_):
        raise AssertionError("the picture was unpacked")

    monkeypatch.setattr("PIL.ImageFile.ImageFile.load", unpack)
    for side in (9_000, 20_000, 60_000):
        file = tmp_path / "bomb.png"
        file.write_bytes(png_header(side, side))
        with pytest.raises(InputError, match="is too large"):
            read_picture(file)


def test_missing_pictures_folders_and_devices_are_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="no picture"):
        read_picture(tmp_path / "nowhere.png")
    with pytest.raises(InputError, match="not a file"):
        read_picture(tmp_path)
    with pytest.raises(InputError, match="not a file"):
        read_picture(Path("/dev/zero"))


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "P", "1"])
def test_pictures_of_every_mode_become_rgb(mode, tmp_path) -> None:
    file = tmp_path / "picture.png"
    Image.new("RGB", (100, 80), (255, 255, 255)).convert(mode).save(file)
    picture = read_picture(file)
    assert picture.shape == (80, 100, 3) and picture.dtype == np.uint8
    assert (picture == 255).all()


def test_pictures_are_turned_as_their_camera_was_held(tmp_path) -> None:
    file = tmp_path / "picture.jpg"
    exif = Image.Exif()
    exif[0x0112] = 6  # rotated by a quarter
    Image.new("RGB", (120, 70)).save(file, exif=exif)
    assert read_picture(file).shape == (120, 70, 3)


def exif(*entries: tuple[int, int, bytes]) -> bytes:
    """EXIF of some tags, each with its type and four bytes of one value or of text."""
    tags = [
        struct.pack(">HHI", tag, kind, 4 if kind == 2 else 1) + value
        for tag, kind, value in sorted(entries)
    ]
    return b"Exif\0\0MM\0*\0\0\0\x08" + struct.pack(">H", len(tags)) + b"".join(tags) + bytes(4)


@pytest.mark.parametrize(
    "odd",
    [
        (0x010F, 5, struct.pack(">I", 8)),  # the maker as a fraction
        (0x0100, 2, b"abc\0"),  # the width as a text
        (0x011A, 2, b"abc\0"),  # the resolution as a text
    ],
)
@pytest.mark.parametrize("form", ["png", "jpeg"])
def test_tags_that_say_nothing_of_turning_are_not_read(odd, form, tmp_path) -> None:
    file = tmp_path / f"picture.{form}"
    turned = exif((0x0112, 3, b"\0\x06\0\0"), odd)
    Image.new("RGB", (120, 70)).save(file, exif=turned)
    assert read_picture(file).shape == (120, 70, 3)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_picture_is_turned_like_pillow_turns_it(orientation, tmp_path) -> None:
    file = tmp_path / "picture.png"
    pixels = np.random.default_rng(0).integers(0, 256, (70, 120, 3), np.uint8)
    tag = (0x0112, 3, struct.pack(">HH", orientation, 0))
    Image.fromarray(pixels).save(file, exif=exif(tag))
    expected = np.asarray(ImageOps.exif_transpose(Image.open(file)))
    np.testing.assert_array_equal(read_picture(file), expected)


def finish(folder: Path, text: str = "new") -> None:
    (folder / "page.html").write_text(text)
    document = {"kind": RESULT_KIND, "files": ["page.html"]}
    (folder / RESULT_FILE).write_text(json.dumps(document))


def test_a_folder_is_there_whole(tmp_path) -> None:
    out = tmp_path / "deep" / "out"
    with written_whole(out) as folder:
        finish(folder)
        assert not out.exists()
    assert sorted(f.name for f in out.iterdir()) == ["page.html", RESULT_FILE]
    assert [f.name for f in out.parent.iterdir()] == ["out"]
    assert out.stat().st_mode & 0o777 == 0o755


def test_or_it_is_not_there_at_all(tmp_path) -> None:
    with pytest.raises(RuntimeError), written_whole(tmp_path / "out") as folder:
        finish(folder)
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_the_earlier_run(tmp_path) -> None:
    out = tmp_path / "out"
    with written_whole(out) as folder:
        finish(folder, "old")
    with pytest.raises(OutputError, match="No space left on device"), written_whole(out) as folder:
        finish(folder, "new")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert (out / "page.html").read_text() == "old"
    assert [f.name for f in tmp_path.iterdir()] == ["out"]


def test_an_earlier_run_is_replaced(tmp_path) -> None:
    out = tmp_path / "out"
    for text in ("old", "new"):
        with written_whole(out) as folder:
            finish(folder, text)
    assert (out / "page.html").read_text() == "new"
    assert [f.name for f in tmp_path.iterdir()] == ["out"]


def test_other_files_are_never_replaced(tmp_path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("years of work")
    with pytest.raises(OutputError, match="holds other files"):
        check_writable(out)
    with written_whole(tmp_path / "run") as folder:
        finish(folder)
    (tmp_path / "run" / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match="holds other files"):
        check_writable(tmp_path / "run")


@pytest.mark.parametrize("out", ["/proc/fusionnet", "/dev/null/fusionnet", "/dev/null"])
def test_unwritable_places_are_refused_in_one_line(out) -> None:
    with pytest.raises(OutputError) as refusal:
        check_writable(Path(out))
    assert "\n" not in str(refusal.value) and out in str(refusal.value)


@pytest.mark.parametrize("out", [".", "", "..", "folder", "file/page.html"])
def test_a_folder_is_no_file_to_write(out, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("folder").mkdir()
    Path("file").write_text("mine")
    with pytest.raises(OutputError, match="is a folder; name a file|Cannot write"):
        write_whole(Path(out), "text")
    with pytest.raises(OutputError, match="is a folder; name a file|has to be a folder"):
        check_file(Path(out))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]


def test_views_of_rooms_may_fill_the_folder_one_is_in(tmp_path, monkeypatch) -> None:
    def stop(folder: Path, *_, **__) -> None:
        raise InputError(str(folder))

    (tmp_path / "rooms").mkdir()
    monkeypatch.chdir(tmp_path / "rooms")
    monkeypatch.setattr("fusionnet.apps.views.photograph_rooms", stop)
    with pytest.raises(InputError, match="rooms-photographs"):
        rooms(RoomsConfig(out=Path()))


def test_rooms_of_which_no_photograph_can_be_used_make_no_folder(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("fusionnet.apps.views.photograph_rooms", lambda *_, **__: [])
    monkeypatch.setattr("fusionnet.apps.views._calibrated", lambda *_: None)
    nothing = ImportedViews((), ())
    monkeypatch.setattr("fusionnet.apps.views.import_views", lambda *_, **__: nothing)
    with pytest.raises(InputError, match="No photograph can become a view"):
        rooms(RoomsConfig(out=tmp_path / "rooms"))
    assert not (tmp_path / "rooms").exists()


def test_no_warning_escapes_from_a_large_picture(tmp_path) -> None:
    file = tmp_path / "picture.png"
    file.write_bytes(png_header(10_000, 10_000))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError):
            read_picture(file)
