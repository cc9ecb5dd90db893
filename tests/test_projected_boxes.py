"""Boxes that a layout explains are those that the renderer labels."""

import numpy as np
import pytest
import torch
from torchvision.ops import box_iou

from fusionnet.blocks import CLASS_NAMES, Block, Cell, Color, Layout, Shape
from fusionnet.dataset.layouts import varied_layout
from fusionnet.dataset.pictures import block_offsets
from fusionnet.geometry import apply, invert
from fusionnet.models.heads.boxes import Boxes
from fusionnet.models.projected_boxes import IN_THE_MIDDLE, projected_boxes, with_leftovers
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, SceneRenderer
from fusionnet.simulation.tabletop import cell_center

SIZE = (960, 540)


@pytest.fixture(scope="module")
def renderer():
    return SceneRenderer("nico", size=SIZE)


def explained(renderer, cells, offsets=IN_THE_MIDDLE):
    """The boxes of a soft layout through the nominal left eye."""
    camera, board = renderer.camera("left_eye"), renderer.robot.robot_from_board
    viewpoint = apply(invert(board), camera.position[None])[0]
    return projected_boxes(cells, project_by(renderer), viewpoint, SIZE, offsets)


def project_by(renderer):
    """From the board's frame to the left eye's pixels."""
    camera, board = renderer.camera("left_eye"), renderer.robot.robot_from_board
    return lambda points: camera.project(apply(board, points)) + 0.5


def certain(layout):
    return np.eye(17)[layout.cell_classes.reshape(512)]


@pytest.mark.parametrize("seed", range(6))
def test_boxes_are_those_of_the_renderer(renderer, seed):
    rng = generator(seed, "projected")
    layout = varied_layout(rng, [], invented=1.0)
    if layout.held is not None:  # the hand hides blocks
        layout = Layout(tuple(b for b in layout.blocks if b is not layout.held))
    view = renderer.view(layout)
    found = explained(renderer, certain(layout))
    overlaps = box_iou(torch.from_numpy(view.boxes), found.xyxy)
    overlaps *= torch.from_numpy(view.classes)[:, None] == found.classes
    # a corner that peeps out by a pixel or not changes a box by much, but few boxes
    shown = torch.from_numpy(view.visible[view.indices] >= 60)
    assert (overlaps.amax(dim=1)[shown] > 0.7).float().mean() > 0.85
    assert abs(len(found.scores) - int((view.visible >= 12).sum())) <= 3
    torch.testing.assert_close(found.scores, torch.ones(len(found.scores)))


def test_blocks_beside_their_cells_are_drawn_where_they_are(renderer):
    layout = Layout(
        tuple(
            Block(Color.RED, Shape.CUBE, Cell(x, y, z))
            for x in range(0, 8, 2)
            for y in range(1, 8, 3)
            for z in range(2)
        )
    )
    rng, count = generator(0, "beside"), len(layout.blocks)
    look = Appearance(
        block_shifts=rng.uniform(-0.003, 0.003, (count, 2)), block_turns=rng.normal(0, 0.06, count)
    )
    view = renderer.view(layout, appearance=look)
    beside = block_offsets(layout, look)
    cells, project = [b.cell.index for b in layout.blocks], project_by(renderer)
    middles = np.array([cell_center(b.cell) for b in layout.blocks])
    moved = project(middles + np.pad(look.block_shifts, ((0, 0), (0, 1)))) - project(middles)
    beside[cells, :2] = moved
    shown = torch.from_numpy(view.visible[view.indices] >= 60)
    truth = torch.from_numpy(view.boxes)[shown]

    def overlap(offsets):
        return box_iou(truth, explained(renderer, certain(layout), offsets).xyxy).amax(dim=1)

    assert overlap(beside).mean() > 0.93 > 0.85 > overlap(IN_THE_MIDDLE).mean()
    assert overlap(beside).min() > 0.8


def test_a_doubtful_block_gives_a_box_and_hides_nothing(renderer):
    sure = Layout((Block(Color.BLUE, Shape.CUBE, Cell(5, 4, 0)),))
    cells = certain(sure)
    doubtful = Cell(3, 4, 1).index  # before it
    cells[doubtful] = 0.0
    cells[doubtful, [2, 10, 16]] = 0.2, 0.1, 0.7
    alone, both = explained(renderer, certain(sure)), explained(renderer, cells)
    assert sorted(CLASS_NAMES[int(k)] for k in both.classes) == sorted(
        [CLASS_NAMES[k] for k in (2, 10)] + [CLASS_NAMES[int(alone.classes[0])]]
    )
    row = int((both.classes == alone.classes[0]).nonzero()[0, 0])
    torch.testing.assert_close(both.xyxy[row], alone.xyxy[0])
    torch.testing.assert_close(both.scores[both.classes == 2], torch.tensor([0.2]))


def test_an_empty_table_has_no_boxes(renderer):
    assert len(explained(renderer, certain(Layout(()))).scores) == 0


def test_what_no_cell_explains_is_kept_with_less_weight():
    box = torch.tensor([[100.0, 90.0, 140.0, 130.0]], dtype=torch.float64)
    ours = Boxes(box, torch.tensor([3]), torch.tensor([0.9]))
    others = Boxes(torch.cat([box, box]) + 2, torch.tensor([3, 4]), torch.tensor([0.8, 0.5]))
    kept = with_leftovers(ours, others)
    assert kept.classes.tolist() == [3, 4]
    torch.testing.assert_close(kept.xyxy[0], box[0])
    torch.testing.assert_close(kept.scores, torch.tensor([0.9, 0.2]))
    none = Boxes(torch.zeros(0, 4).double(), torch.zeros(0).long(), torch.zeros(0))
    assert with_leftovers(none, none).classes.tolist() == []
    assert with_leftovers(none, others).classes.tolist() == [3, 4]
