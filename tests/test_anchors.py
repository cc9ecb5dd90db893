"""Anchors: k-medians under IoU against a plain loop, and the step to sizes, ratios and scales."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusionnet.errors import DataError, InputError
from fusionnet.models.anchors import (
    AnchorShapes,
    ClusterConfig,
    k_medians,
    mean_iou,
    pyramid_anchors,
    thesis_anchors,
)
from fusionnet.randomness import generator


def plain_k_medians(sides, start, iterations=100):
    """Box by box, as the thesis's source did it: the yardstick for the fast one."""
    clusters, nearest = start.astype(float).copy(), None
    for _ in range(iterations):
        overlaps = np.array([[plain_iou(box, c) for c in clusters] for box in sides])
        chosen = overlaps.argmax(1)
        if nearest is not None and (chosen == nearest).all():
            break
        nearest = chosen
        for k in range(len(clusters)):
            if (chosen == k).any():
                clusters[k] = np.median(sides[chosen == k], axis=0)
    return clusters, overlaps.max(1).mean()


def plain_iou(a, b):
    shared = min(a[0], b[0]) * min(a[1], b[1])
    return shared / (a[0] * a[1] + b[0] * b[1] - shared)


@settings(max_examples=25)
@given(st.integers(0, 10_000), st.integers(2, 40), st.integers(1, 5))
def test_it_finds_what_a_plain_loop_finds(seed, count, clusters):
    rng = np.random.default_rng(seed)
    sides = rng.integers(1, 12, (count, 2)).astype(float)
    config = ClusterConfig(clusters=clusters, repetitions=1, seed=seed)
    found = k_medians(sides, config)
    drawn = generator(seed, "anchors", 0).choice(count, size=min(clusters, count), replace=False)
    wanted, overlap = plain_k_medians(sides, sides[drawn])
    np.testing.assert_allclose(found.shapes, wanted[np.argsort(wanted.prod(1), kind="stable")])
    assert found.mean_iou == pytest.approx(overlap)
    assert mean_iou(sides, found.shapes) == pytest.approx(overlap)


def test_shapes_that_are_there_are_found():
    true = np.array([[20.0, 25.0], [40.0, 44.0], [90.0, 80.0]])
    rng = np.random.default_rng(0)
    sides = np.repeat(true, 200, axis=0) + rng.uniform(-1, 1, (600, 2))
    found = k_medians(sides, ClusterConfig(clusters=3))
    np.testing.assert_allclose(found.shapes, true, atol=0.5)
    best = max(curve[-1] for curve in found.curves)
    assert len(found.curves) == 10 and found.mean_iou == pytest.approx(best)
    assert found.mean_iou > 0.95
    assert k_medians(sides, ClusterConfig(clusters=3)).curves == found.curves


def test_many_fractions_of_pixels_are_clustered_to_half_a_pixel():
    sides = np.random.default_rng(1).uniform(10, 90, (30_000, 2))
    found = k_medians(sides, ClusterConfig(repetitions=1))
    assert (found.shapes * 4 == np.rint(found.shapes * 4)).all()
    assert found.mean_iou == pytest.approx(mean_iou(sides, found.shapes))
    assert found.mean_iou == pytest.approx(found.curves[0][-1], abs=1e-3)


@pytest.mark.parametrize("sides", [np.zeros((0, 2)), np.array([[3.0, 0.0]])])
def test_boxes_without_area_are_refused(sides):
    with pytest.raises(DataError):
        k_medians(sides)
    with pytest.raises(InputError, match="at least 1"):
        ClusterConfig(clusters=0)


def test_the_step_from_clusters_to_anchors():
    clusters = np.array([[10.0, 9.0], [20.0, 20.0], [40.0, 44.0]])
    found = pyramid_anchors(clusters, levels=3)
    assert found.ratios == (0.9, 1.0, 1.1)
    middle = np.array(found.sizes) * 2 ** (1 / 3)
    np.testing.assert_allclose(middle, np.sqrt(clusters.prod(1)), rtol=0.01)
    assert len(found.shapes()) == 27


def test_the_shapes_of_anchors_have_their_area_and_their_ratio():
    shapes = thesis_anchors().shapes()
    assert len(shapes) == 5 * 9
    first = AnchorShapes(sizes=(30.0,), ratios=(0.85,), scales=(1.0,)).shapes()[0]
    assert first.prod() == pytest.approx(900.0) and first[1] / first[0] == pytest.approx(0.85)
    assert shapes.prod(1).min() == pytest.approx(900.0)
