"""Views in a folder: they come back as they were, and what is wrong with one is named."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusionnet.errors import DataError, InputError, OutputError
from fusionnet.geometry import rotation_from_vector, transform
from fusionnet.views import EnvironmentalView, check_view, load_views, save_views
from fusionnet.views.view_files import names_for

DOWN = np.diag([1.0, -1.0, -1.0])


def made_view(name: str = "room-01", **changes: object) -> EnvironmentalView:
    """A camera 0.8 m above the grid's middle, looking straight down at noise."""
    image = np.random.default_rng(7).integers(0, 255, (90, 160, 3), dtype=np.uint8)
    view = EnvironmentalView(
        name=name,
        environment="room",
        part="train",
        image=image,
        matrix=np.array([[120.5, 0.0, 79.5], [0.0, 119.5, 44.5], [0.0, 0.0, 1.0]]),
        camera_from_board=transform(DOWN, np.array([-0.1052, 0.1052, 0.8])),
    )
    return replace(view, **changes)


def test_views_come_back_as_they_were(tmp_path: Path) -> None:
    lamps = np.array([[0.6, 0.0, -0.8], [0.0, 0.0, -1.0]])
    views = (made_view(), made_view("room-02", part="val", light_directions=lamps))
    save_views(tmp_path / "views", views, quality=None)
    for saved, read in zip(views, load_views(tmp_path / "views"), strict=True):
        assert (read.name, read.environment, read.part) == (saved.name, "room", saved.part)
        np.testing.assert_array_equal(read.image, saved.image)
        np.testing.assert_array_equal(read.matrix, saved.matrix)
        np.testing.assert_array_equal(read.camera_from_board, saved.camera_from_board)
        np.testing.assert_array_equal(read.light_directions, saved.light_directions)


def test_views_of_the_first_version_know_no_lamps(tmp_path: Path) -> None:
    save_views(tmp_path / "views", (made_view(),))
    file = tmp_path / "views" / "views.json"
    document = json.loads(file.read_text()) | {"schema_version": 1}
    del document["views"][0]["light_directions"]
    file.write_text(json.dumps(document))
    (view,) = load_views(tmp_path / "views")
    assert view.light_directions.shape == (0, 3)


@given(st.lists(st.floats(-0.1, 0.1), min_size=3, max_size=3))
def test_a_turned_camera_that_sees_the_grid_is_accepted_and_one_turned_away_is_not(
    turn: list[float],
) -> None:
    view = made_view()
    near = transform(rotation_from_vector(np.array(turn))) @ view.camera_from_board
    check_view(replace(view, camera_from_board=near))
    away = transform(rotation_from_vector(np.array([1.5, 0.0, 0.0]))) @ near
    with pytest.raises(InputError, match="room-01.*(leaves the picture|behind its camera)"):
        check_view(replace(view, camera_from_board=away))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "../escaped"}, "cannot be called"),
        ({"matrix": np.diag([120.0, -120.0, 1.0])}, "intrinsics"),
        ({"matrix": np.diag([np.nan, 120.0, 1.0])}, "not finite"),
        ({"camera_from_board": np.diag([2.0, 1.0, 1.0, 1.0])}, "no rigid transform"),
        ({"camera_from_board": transform(translation=(0.0, 0.0, 0.8))}, "below the table"),
        ({"light_directions": np.array([[0.0, 0.0, -2.0]])}, "vectors of length 1"),
        ({"light_directions": np.array([[0.0, np.nan, -1.0]])}, "vectors of length 1"),
        ({"light_directions": np.array([[0.0, 0.6, 0.8]])}, "come from above the table"),
    ],
)
def test_an_impossible_view_is_refused_and_nothing_is_written(
    tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        save_views(tmp_path / "views", (made_view(), made_view(**({"name": "b"} | changes))))
    assert list(tmp_path.iterdir()) == []


def test_views_that_could_not_be_read_again_are_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds 1 to 10000 views; received 0"):
        save_views(tmp_path / "views", ())
    small = np.zeros((60, 107, 3), np.uint8)
    matrix = np.array([[80.0, 0.0, 53.0], [0.0, 80.0, 29.5], [0.0, 0.0, 1.0]])
    with pytest.raises(InputError, match="picture of the view 'room-01' is too small, 107 x 60"):
        save_views(tmp_path / "views", (made_view(image=small, matrix=matrix),))
    assert list(tmp_path.iterdir()) == []


def test_a_name_for_any_text_is_its_own_and_can_be_saved(tmp_path: Path) -> None:
    texts = ["room-IMG_1", "room-IMG_1", "Küche 2-IMG (3)", "_-.", "..", "room-IMG_1-2", "a" * 200]
    names = names_for(texts)
    assert names[:5] == ["room-IMG_1", "room-IMG_1-2", "K-che-2-IMG--3-", "view", "view-2"]
    save_views(tmp_path / "views", tuple(made_view(name) for name in names))
    assert [view.name for view in load_views(tmp_path / "views")] == names


def test_views_are_not_written_over_files_that_are_there(tmp_path: Path) -> None:
    (tmp_path / "precious.txt").write_text("mine")
    with pytest.raises(OutputError, match="holds files already"):
        save_views(tmp_path, (made_view(),))
    with pytest.raises(OutputError, match="is a file"):
        save_views(tmp_path / "precious.txt", (made_view(),))
    with pytest.raises(InputError, match="Several views are called 'room-01'"):
        save_views(tmp_path / "new", (made_view(), made_view()))


def test_what_is_wrong_with_a_folder_of_views_is_named(tmp_path: Path) -> None:
    folder = tmp_path / "views"
    with pytest.raises(InputError, match="There is no folder of views"):
        load_views(folder)
    save_views(folder, (made_view(),))
    file = folder / "views.json"
    whole = json.loads(file.read_text())

    def refused(message: str, **changes: object) -> None:
        file.write_text(json.dumps(whole | {"views": [whole["views"][0] | changes]}))
        with pytest.raises(DataError, match=message):
            load_views(folder)

    refused("'part' is 'train' or 'val', not 'test'", part="test")
    refused("name of a picture beside it", file="../x.jpg")
    refused("There is no picture", file="other.jpg")
    refused("3 rows of 3 numbers", matrix=[[1, 2]])
    refused("expected an object with", extra=1)
    refused("2 rows of 3 numbers", light_directions=[[0, 0, -1], [1]])
    refused("1 rows of 3 numbers", light_directions="above")
    shifted = np.array(whole["views"][0]["camera_from_board"])
    shifted[0, 3] += 0.5
    refused("room-01.*leaves the picture", camera_from_board=shifted.tolist())
    file.write_text(json.dumps(whole | {"schema_version": 0}))
    with pytest.raises(DataError, match="schema version 0"):
        load_views(folder)
    file.write_text(json.dumps(whole)[:-20])
    with pytest.raises(DataError, match="not JSON"):
        load_views(folder)
    file.write_text(json.dumps(whole))
    picture = folder / "room-01.jpg"
    picture.write_bytes(picture.read_bytes()[:-500])
    with pytest.raises(DataError, match="room-01.jpg is damaged"):
        load_views(folder)
    file.unlink()
    with pytest.raises(DataError, match="has no views.json"):
        load_views(folder)
