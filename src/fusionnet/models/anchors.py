"""Which boxes a detector should start from: k-medians of a data set's boxes under IoU.

Only the width and the height of a box count, as if all boxes had one corner in common.
Boxes are measured in whole pixels, so that 700,000 of them have a few thousand shapes;
clustering the shapes with their counts gives the same as clustering the boxes. Where boxes
have fractions of pixels and too many shapes, they are clustered to half a pixel.

References:
    Redmon et al. (2016), YOLO9000, section 2; thesis, section 6.1.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from fusionnet.errors import DataError, InputError
from fusionnet.randomness import generator

THESIS_MEAN_IOU = {"whole": 0.8687, "cropped": 0.8682}
"""Of the thesis's nine clusters on its training pictures, whole and cropped (6.1.2)."""

SCALES = (1.0, 2 ** (1 / 3), 2 ** (2 / 3))
"""Factors on the size of each pyramid level (tables 6.1 and 7.2)."""

MOST_SHAPES = 20_000
"""Different shapes above which boxes are clustered to half a pixel."""


@dataclass(frozen=True, kw_only=True)
class ClusterConfig:
    """How to cluster.

    Attributes:
        clusters: Shapes to find (thesis: nine, one for each anchor of a location).
        repetitions: Starts from other boxes, of which the best is kept (thesis: ten).
        iterations: After which a repetition stops anyway (thesis: 100).
        seed: Of the boxes that the repetitions start from.
        center: What of a cluster's widths and heights its new shape is; the thesis found
            medians better than the means of YOLO9000.
    """

    clusters: int = 9
    repetitions: int = 10
    iterations: int = 100
    seed: int = 0
    center: Literal["median", "mean"] = "median"

    def __post_init__(self) -> None:
        """Refuse counts below 1."""
        if min(self.clusters, self.repetitions, self.iterations) < 1:
            raise InputError(f"clusters, repetitions and iterations are at least 1; got {self}")


@dataclass(frozen=True)
class Clusters:
    """What k-medians found.

    Attributes:
        shapes: Widths and heights of the best repetition, in pixels, smallest area first.
        mean_iou: Of every box with the shape nearest to it, in the best repetition.
        curves: Mean IoU after each iteration, for every repetition (figure 6.1 a).
    """

    shapes: Float[np.ndarray, "k 2"]
    mean_iou: float
    curves: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class AnchorShapes:
    """The anchors of a feature pyramid, as RetinaNet is given them.

    Attributes:
        sizes: Square root of the smallest anchor's area, a pyramid level, in pixels.
        ratios: Heights over widths.
        scales: Factors on each size.
    """

    sizes: tuple[float, ...]
    ratios: tuple[float, ...]
    scales: tuple[float, ...] = SCALES

    def shapes(self) -> Float[np.ndarray, "n 2"]:
        """Widths and heights of all anchors, in pixels."""
        sides = np.multiply.outer(self.sizes, self.scales).ravel()
        roots = np.sqrt(self.ratios)
        return np.stack(
            [np.multiply.outer(sides, 1 / roots), np.multiply.outer(sides, roots)], axis=-1
        ).reshape(-1, 2)


def thesis_anchors() -> AnchorShapes:
    """The thesis's, for pictures of 990 x 540 pixels (table 7.2)."""
    return AnchorShapes(sizes=(30.0, 53.0, 90.0, 100.0, 150.0), ratios=(17 / 20, 1.0, 11 / 10))


def k_medians(
    sides: Float[np.ndarray, "n 2"],
    config: ClusterConfig | None = None,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Clusters:
    """Cluster boxes by their shape; each repetition stops early when no box changes cluster.

    Args:
        sides: Width and height of every box, in pixels.
        config: How to cluster.
        progress: Called with repetitions done and repetitions in all.

    Raises:
        DataError: If there are no boxes, or one without area.
    """
    config = config or ClusterConfig()
    shapes, counts = exact, times = _shapes(sides)
    if len(shapes) > MOST_SHAPES:
        shapes, counts = _shapes(np.maximum(np.rint(np.asarray(sides) * 2) / 2, 0.5))
    best: tuple[float, np.ndarray] | None = None
    curves = []
    for repetition in range(config.repetitions):
        rng = generator(config.seed, "anchors", repetition)
        drawn = rng.choice(len(sides), size=min(config.clusters, len(sides)), replace=False)
        found, curve = _one_run(shapes, counts, np.asarray(sides)[drawn], config)
        curves.append(curve)
        if best is None or curve[-1] > best[0]:
            best = curve[-1], found
        if progress is not None:
            progress(repetition + 1, config.repetitions)
    assert best is not None
    order = np.argsort(best[1].prod(axis=1), kind="stable")
    found = best[1][order]
    return Clusters(found, _mean_iou(exact, times, found), tuple(curves))


def mean_iou(sides: Float[np.ndarray, "n 2"], anchors: Float[np.ndarray, "k 2"]) -> float:
    """Mean over all boxes of the IoU with the anchor whose shape is nearest.

    Raises:
        DataError: If there are no boxes, or one without area.
    """
    return _mean_iou(*_shapes(sides), anchors)


def pyramid_anchors(
    clusters: Float[np.ndarray, "k 2"], *, levels: int = 5, scales: tuple[float, ...] = SCALES
) -> AnchorShapes:
    """From clusters to what RetinaNet is given: sizes, ratios and scales.

    Sizes go with even steps through the clusters' sides (square roots of their areas), so
    that the middle scale of each level lies on them, as far as there are as many. The ratios
    are the flattest cluster's, the steepest one's, and 1 (thesis 6.1.2).

    Args:
        clusters: Widths and heights, in pixels.
        levels: Levels of the pyramid.
        scales: Factors on each level's size.
    """
    sides = np.sort(np.sqrt(clusters.prod(axis=1)))
    places = np.linspace(0, len(sides) - 1, levels)
    middle = sorted(scales)[len(scales) // 2]
    sizes = np.interp(places, np.arange(len(sides)), sides) / middle
    ratios = clusters[:, 1] / clusters[:, 0]
    wanted = sorted({round(float(r), 3) for r in (ratios.min(), 1.0, ratios.max())})
    return AnchorShapes(tuple(round(float(s), 1) for s in sizes), tuple(wanted), scales)


def _shapes(
    sides: Float[np.ndarray, "n 2"],
) -> tuple[Float[np.ndarray, "m 2"], Int[np.ndarray, " m"]]:
    """Every shape once, with the number of boxes that have it."""
    sides = np.asarray(sides, dtype=np.float64)
    if not len(sides):
        raise DataError("There is no box to find anchors for: no picture shows a block.")
    if not np.isfinite(sides).all() or sides.min() <= 0:
        raise DataError("Boxes need a width and a height above 0 pixels.")
    # One complex number a shape: much faster to sort than rows.
    shapes, counts = np.unique(sides[:, 0] + 1j * sides[:, 1], return_counts=True)
    return np.stack([shapes.real, shapes.imag], axis=1), counts


def _mean_iou(
    shapes: Float[np.ndarray, "m 2"],
    counts: Int[np.ndarray, " m"],
    anchors: Float[np.ndarray, "k 2"],
) -> float:
    return float(np.average(_overlaps(shapes, anchors).max(axis=0), weights=counts))


def _overlaps(
    shapes: Float[np.ndarray, "m 2"], clusters: Float[np.ndarray, "k 2"]
) -> Float[np.ndarray, "k m"]:
    """IoU of every cluster with every shape, both with one corner at the origin."""
    width, height = np.ascontiguousarray(shapes.T)
    shared = np.minimum(clusters[:, :1], width) * np.minimum(clusters[:, 1:], height)
    return shared / (clusters.prod(axis=1)[:, None] + width * height - shared)


def _one_run(
    shapes: Float[np.ndarray, "m 2"],
    counts: Int[np.ndarray, " m"],
    clusters: Float[np.ndarray, "k 2"],
    config: ClusterConfig,
) -> tuple[Float[np.ndarray, "k 2"], tuple[float, ...]]:
    """The clusters of one repetition, and its curve of mean IoU."""
    by_side = [np.argsort(shapes[:, side], kind="stable") for side in (0, 1)]
    clusters = np.array(clusters, dtype=np.float64)
    nearest, curve = None, []
    center = _median if config.center == "median" else _mean
    for _ in range(config.iterations):
        overlaps = _overlaps(shapes, clusters)
        chosen = overlaps.argmax(axis=0)
        curve.append(float(np.average(overlaps.max(axis=0), weights=counts)))
        if nearest is not None and np.array_equal(chosen, nearest):
            break
        nearest = chosen
        for side, order in enumerate(by_side):
            for cluster in range(len(clusters)):
                members = order[chosen[order] == cluster]
                if len(members):
                    clusters[cluster, side] = center(shapes[members, side], counts[members])
    return clusters, tuple(curve)


def _median(values: Float[np.ndarray, " n"], counts: Int[np.ndarray, " n"]) -> float:
    """Median of sorted values of which each occurs as often as its count."""
    ends = np.cumsum(counts)
    low, high = np.searchsorted(ends, [(ends[-1] + 1) // 2, ends[-1] // 2 + 1])
    return float(values[low] + values[high]) / 2


def _mean(values: Float[np.ndarray, " n"], counts: Int[np.ndarray, " n"]) -> float:
    """Mean of values of which each occurs as often as its count."""
    return float(np.average(values, weights=counts))
