"""What the thesis's FusionNet is measured by on stored samples (table 7.4, and executed).

Two ways to ask: with the true target given to the decoder, as in training and in the thesis's
validation, and in two stages, as the robot must (4.3.3): the target is written first.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from lightning.fabric.utilities import move_data_to_device

from fusionnet.blocks import Layout, layout_from_json
from fusionnet.models.heads import Example
from fusionnet.models.thesis_fusionnet import JOINTS, ThesisFusionNet
from fusionnet.randomness import derived_seed
from fusionnet.simulation import make_world
from fusionnet.training.fusion_examples import FusionExamples

HOPELESS = 10.0
"""Mean error of a pose, in degrees, above which an episode need not be run to have failed."""

_AT_ONCE = 16


@torch.inference_mode()
def measure(
    model: ThesisFusionNet, examples: FusionExamples, count: int, *, episodes: int = 0
) -> dict[str, Any]:
    """Losses, metrics of every head, and errors of the joints on the first samples of a split.

    Args:
        model: In evaluation mode; its device is used.
        examples: The split; sentences are clean, pictures as they are stored.
        count: Samples at most.
        episodes: How many of the samples are executed in the simulator.

    Returns:
        With the true target given `loss_NAME` of every head and every head's metrics. In two
        stages `joint_mse_two_stage`, the errors of `degrees`, `target_exact` (the share of
        targets written without a fault) and `executed_success`.
    """
    device = next(model.parameters()).device
    model.eval()
    count = min(count, len(examples))
    given: dict[str, list[Any]] = {name: [] for name in model.heads}
    truth: dict[str, list[Any]] = {name: [] for name in model.heads}
    losses: dict[str, float] = dict.fromkeys(model.heads, 0.0)
    samples: list[Mapping[str, Any]] = []
    answers: list[Float[np.ndarray, " k"]] = []
    exact = 0
    for first in range(0, count, _AT_ONCE):
        some = [examples.example(i, model) for i in range(first, min(first + _AT_ONCE, count))]
        batch = model.batch_of(some)
        for name, targets in batch.targets.items():
            truth[name] += targets
        batch = _moved(batch, device)
        features = model.features(batch.images, batch.source, batch.given)
        for name in model.heads:
            head = model.head(name)
            output = head(features)
            losses[name] += float(head.loss(output, batch.targets[name], features)) * len(some)
            given[name] += head.predict(output)
        written = model.write(batch.source)
        exact += sum(_same(row.tolist(), e) for row, e in zip(written.cpu(), some, strict=True))
        again = model.features(batch.images, batch.source, written)
        answers += [t.numpy() for t in model.head(JOINTS)(again).cpu()]
        samples += [e.sample for e in some]
    found: dict[str, Any] = {f"loss_{name}": total / count for name, total in losses.items()}
    for name in model.heads:
        found |= model.head(name).metric(given[name], truth[name])
    wanted = np.array([np.array(s["joints"]) for s in samples])
    own = model.unscale(np.array(answers, dtype=float))
    found |= degrees(own, wanted)
    found["joint_mse_two_stage"] = float(((model.scale(own) - model.scale(wanted)) ** 2).mean())
    found["target_exact"] = exact / count
    found["samples"] = count
    if episodes:
        reached = [
            executed(model.config.robot, sample, answer, number)
            for number, (sample, answer) in enumerate(
                zip(samples[:episodes], own[:episodes], strict=True)
            )
        ]
        found["executed_success"], found["episodes"] = float(np.mean(reached)), len(reached)
    return found


def degrees(found: Float[np.ndarray, "n k"], wanted: Float[np.ndarray, "n k"]) -> dict[str, float]:
    """Mean error of the joints of the grasp, of the place, and of both, in degrees (7.5)."""
    errors = np.degrees(np.abs(found - wanted))
    middle = errors.shape[1] // 2
    grasp, place = float(errors[:, : middle - 1].mean()), float(errors[:, middle:-1].mean())
    return {
        "grasp_error_degrees": grasp,
        "place_error_degrees": place,
        "joint_error_degrees": (grasp + place) / 2,
    }


def executed(
    robot: str, sample: Mapping[str, Any], answer: Float[np.ndarray, " k"], number: int
) -> bool:
    """Whether the simulator's blocks end where they should; a hopeless answer is not run."""
    wanted = np.array(sample["joints"])
    errors = degrees(answer[None], wanted[None])
    if max(errors.values()) > HOPELESS:
        return False
    before, after = _layout(sample["before"]), _layout(sample["after"])
    world = make_world(robot=robot, seed=derived_seed(0, "world", number), layout=before)
    limits = world.robot.joint_limits
    safe = np.array(answer, dtype=float)
    middle = len(safe) // 2
    for start in (0, middle):
        joints = slice(start, start + middle - 1)
        safe[joints] = np.clip(safe[joints], limits[:, 0], limits[:, 1])
    return bool(world.execute(safe, expected=after).success)


def _layout(text: str) -> Layout:
    return layout_from_json(json.loads(text))


def _same(written: Sequence[int], example: Example) -> bool:
    """Whether a row of tokens, filled up with padding, is the true target without its end."""
    true = list(example.target[:-1])
    return list(written[: len(true)]) == true and not any(written[len(true) :])


def _moved(batch: Any, device: torch.device) -> Any:
    return move_data_to_device(batch, device)
