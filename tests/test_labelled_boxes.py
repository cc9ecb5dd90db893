"""Average precision against pycocotools, on boxes that are partly right."""

import contextlib
import io

import numpy as np
import pytest
import torch
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from fusionnet.blocks import CLASS_NAMES
from fusionnet.models.labelled_boxes import Boxes, BoxPrecision


def boxes(corners, kinds, scores=None):
    corners = torch.as_tensor(np.asarray(corners, dtype=float).reshape(-1, 4)).float()
    scores = torch.ones(len(corners)) if scores is None else torch.as_tensor(scores).float()
    return Boxes(corners, torch.as_tensor(np.asarray(kinds, dtype=np.int64)), scores)


def pictures(seed, count=6):
    """Truth and detections: some moved a little, some of another class, some made up."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        many = int(rng.integers(0, 14))
        corners = rng.uniform(0, 400, (many, 2))
        truth = np.concatenate([corners, corners + rng.uniform(12, 90, (many, 2))], axis=1)
        kinds = rng.choice([0, 3, 10, 15], many)
        found = np.repeat(truth, 2, axis=0) + rng.normal(0, 3, (2 * many, 4))
        guessed = np.where(rng.random(2 * many) < 0.8, np.repeat(kinds, 2), 3)
        kept = rng.random(2 * many) < 0.7
        yield boxes(truth, kinds), boxes(found[kept], guessed[kept], rng.random(kept.sum()))


def by_pycocotools(pairs):
    """AP at 0.5 and from 0.5 to 0.95, by class."""
    truth, found = [], []
    for picture, (right, seen) in enumerate(pairs, 1):
        for which, target in ((right, truth), (seen, found)):
            columns = (which.xyxy, which.classes, which.scores)
            rows = zip(*(column.tolist() for column in columns), strict=True)
            for (left, top, far, low), kind, score in rows:
                box = [left, top, far - left, low - top]
                entry = {"image_id": picture, "category_id": kind + 1, "bbox": box, "score": score}
                entry |= {"area": box[2] * box[3], "iscrowd": 0, "id": len(target) + 1}
                target.append(entry)
    with contextlib.redirect_stdout(io.StringIO()):
        coco = COCO()
        coco.dataset = {
            "images": [{"id": i + 1} for i in range(len(pairs))],
            "categories": [{"id": i + 1, "name": n} for i, n in enumerate(CLASS_NAMES)],
            "annotations": truth,
        }
        coco.createIndex()
        evaluation = COCOeval(coco, coco.loadRes(found), "bbox")
        evaluation.params.maxDets = [1, 10, 1000]
        evaluation.evaluate()
        evaluation.accumulate()
    precision = evaluation.eval["precision"][:, :, :, 0, -1]
    return {
        name: (precision[0, :, k].mean(), precision[:, :, k].mean())
        for k, name in enumerate(CLASS_NAMES)
        if (precision[:, :, k] > -1).all()
    }


@pytest.mark.parametrize("seed", range(4))
def test_precision_is_that_of_pycocotools(seed):
    pairs = list(pictures(seed))
    precision = BoxPrecision()
    for truth, found in pairs:
        precision.update(found, truth)
    measured, wanted = precision.compute(), by_pycocotools(pairs)
    assert 0.02 < measured["map_50_95"] < measured["map_50"] < 1
    there = {name for name, values in measured["classes"].items() if values["instances"]}
    assert there == set(wanted)
    for name, (half, mean) in wanted.items():
        assert measured["classes"][name]["ap_50"] == pytest.approx(half, abs=1e-4)
        assert measured["classes"][name]["ap_50_95"] == pytest.approx(mean, abs=1e-4)
    means = np.mean(list(wanted.values()), axis=0)
    assert [measured["map_50"], measured["map_50_95"]] == pytest.approx(means.tolist(), abs=2e-4)
    counts = {name: measured["classes"][name]["instances"] for name in there}
    weighted = sum(counts[n] * wanted[n][0] for n in there) / sum(counts.values())
    assert measured["map_50_weighted"] == pytest.approx(weighted, abs=2e-4)


def test_nothing_found_and_nothing_there():
    precision = BoxPrecision()
    assert precision.compute()["map_50"] is None
    precision.update(boxes([], []), boxes([[5, 5, 30, 40]], [2]))
    measured = precision.compute()
    assert measured["map_50"] == 0.0 and measured["classes"][CLASS_NAMES[2]]["instances"] == 1
    assert measured["classes"][CLASS_NAMES[0]]["ap_50"] is None
