"""The corners of the board put the estimated camera right, and nothing else does."""

import numpy as np
import pytest
import torch

from fusionnet.blocks import Block, Cell, Color, Layout, Shape
from fusionnet.dataset.pictures import label
from fusionnet.models.board_corners import board_corners, refined_pose
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, SceneRenderer
from fusionnet.simulation.tabletop import BOARD_THICKNESS
from fusionnet.training.detector import new_detector
from fusionnet.training.detector_batches import collate

BLOCKS = tuple(
    Block(color, Shape.CUBE, Cell(x, y, z))
    for color, x, y, z in (
        (Color.RED, 2, 2, 0),
        (Color.WHITE, 2, 2, 1),
        (Color.GREEN, 5, 3, 0),
        (Color.GRAY, 4, 5, 0),
        (Color.GRAY, 4, 6, 0),
        (Color.WHITE, 5, 5, 0),
        (Color.WHITE, 5, 6, 0),
    )
)


@pytest.fixture(scope="module")
def head():
    return new_detector(0).pose_head


@pytest.fixture(scope="module")
def renderer():
    return SceneRenderer("nico", size=(960, 540))


def seen(renderer, head, seed):
    """A picture in some look, and the true camera."""
    look = Appearance.sample(generator(seed, "corners"))
    picture, labels = label(renderer, Layout(BLOCKS), look)
    batch = collate([(picture, labels)])
    return picture, head.target(batch.matrix, batch.camera_from_board)


@pytest.mark.parametrize("seed", range(5))
def test_a_camera_that_is_off_comes_nearer(renderer, head, seed):
    picture, truth = seen(renderer, head, seed)
    noise = torch.from_numpy(generator(seed, "off").normal(0.0, 0.06, (1, 7))).float()
    before = float(head.metric([truth + noise], truth)[0])
    after = float(head.metric([refined_pose(head, truth + noise, picture)], truth)[0])
    assert after < max(0.5 * before, 0.3)


def test_corners_are_found_where_they_are_and_not_under_blocks(renderer, head):
    picture, truth = seen(renderer, head, 0)
    corners = head.landmarks + torch.tensor([0.0, 0.0, BOARD_THICKNESS])
    expected = head.project(truth, corners)[0].double().numpy()
    which, found = board_corners(picture, expected + 0.7)
    assert len(which) > 25
    off = np.linalg.norm(found - expected[which], axis=1)
    assert np.median(off) < 0.3
    assert 9 * 5 + 6 not in which  # beneath four cubes


@pytest.mark.parametrize("shade", [0, 127, 255])
def test_without_a_board_the_estimate_stands(head, shade):
    picture = np.full((416, 480, 3), shade, np.uint8)
    pose = torch.full((1, 7), 0.1)
    assert refined_pose(head, pose, picture) is pose


def test_noise_is_borne(head):
    picture = generator(0, "noise").integers(0, 256, (416, 480, 3), dtype=np.uint8)
    pose = torch.full((1, 7), 0.1)
    fitted = refined_pose(head, pose, picture)
    assert torch.isfinite(fitted).all()
    assert float(head.metric([fitted], pose)[0]) < 5.0
