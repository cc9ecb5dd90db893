"""One stored sample from its recipe: picture, labels, language, scene and joints."""

import json
from dataclasses import fields, is_dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from fusionnet import robots
from fusionnet.blocks import Layout, Move, layout_to_json, move_between, plan
from fusionnet.corpora import Command
from fusionnet.dataset.masks import encode_masks
from fusionnet.dataset.recipes import Recipe
from fusionnet.dataset.shots import Shot
from fusionnet.randomness import generator
from fusionnet.rcl import Leaf, Tree
from fusionnet.rcl import format as format_tree
from fusionnet.sentences import variants
from fusionnet.simulation import joint_targets

VARIANTS = 3
"""Perturbed variants of each sentence (thesis 3.4.1)."""


def make_sample(recipe: Recipe, shot: Shot, robot: str, quality: int) -> dict[str, Any]:
    """The values of all columns of `schema.COLUMNS`.

    Args:
        recipe: The sample's causes.
        shot: The picture of the layout before.
        robot: Name of the robot whose joints are stored.
        quality: Of the JPEG, 1 to 100.
    """
    command = recipe.command
    view = shot.view
    height, width = view.image.shape[:2]
    recorded = recipe.origin == "recorded"
    return {
        "id": recipe.id,
        "image": {"bytes": encode_jpeg(view.image, quality), "path": f"{recipe.id}.jpg"},
        "width": width,
        "height": height,
        **_blocks(command.scene.before, shot),
        **_language(command, recipe.seed),
        "before": json.dumps(layout_to_json(command.scene.before)),
        "after": json.dumps(layout_to_json(command.scene.after)),
        **_joints(move_of(command), robot),
        "camera": {
            "name": recipe.camera,
            "kind": recipe.kind,
            "environment": shot.environment,
            "matrix": view.camera.matrix.ravel().tolist(),
            "camera_from_board": shot.camera_from_board.ravel().tolist(),
        },
        "robot": robot,
        "noise": shot.noise,
        "seed": recipe.seed,
        "origin": recipe.origin,
        "corpus": command.corpus,
        "group": command.scene.group if recorded else None,
        "scene": command.scene.id if recorded else None,
        "command": command.id if recorded else None,
    }


def encode_jpeg(image: UInt8[np.ndarray, "h w 3"], quality: int) -> bytes:
    """A picture as JPEG."""
    turned = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, encoded = cv2.imencode(".jpg", turned, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return encoded.tobytes()


def move_of(command: Command) -> Move:
    """The recorded move of a command; where the layouts do not tell it, the planner's."""
    scene = command.scene
    return move_between(scene.before, scene.after) or plan(command.tree, scene.before)


def alignments(tree: Tree) -> list[dict[str, Any]]:
    """Each leaf of a tree, depth first, with the positions of its words."""
    found: list[dict[str, Any]] = []

    def visit(name: str, node: Any) -> None:
        if isinstance(node, Leaf):
            found.append({"leaf": name, "value": str(node.value), "tokens": list(node.tokens)})
        elif isinstance(node, tuple):
            for part in node:
                visit(name, part)
        elif is_dataclass(node) and not isinstance(node, type):
            for field in fields(node):
                visit(field.name, getattr(node, field.name))

    visit("tree", tree)
    return found


def _blocks(layout: Layout, shot: Shot) -> dict[str, Any]:
    view = shot.view
    assert view.block_at is not None
    return {
        "boxes": view.boxes.astype(np.float32).tolist(),
        "classes": view.classes.tolist(),
        "box_blocks": view.indices.tolist(),
        "box_hidden": view.mostly_hidden.tolist(),
        "masks": encode_masks(view.block_at, view.indices),
        "block_cells": [block.cell.index for block in layout.blocks],
        "block_classes": [block.class_index for block in layout.blocks],
        "block_pixels": view.visible.tolist(),
        "block_shares": view.shares.tolist(),
        "block_offsets": shot.offsets.astype(np.float32).tolist(),
        "holding": layout.held is not None,
    }


def _language(command: Command, seed: int) -> dict[str, Any]:
    said = []
    for variant in variants(command.sentence, generator(seed, "variants"), VARIANTS):
        tree = variant.realigned(command.tree)
        said.append(
            {
                "sentence": variant.sentence,
                "applied": [str(kind) for kind in variant.applied],
                "tree": format_tree(tree),
                "alignments": alignments(tree),
            }
        )
    return {
        "sentence": command.sentence,
        "tree": format_tree(command.tree),
        "alignments": alignments(command.tree),
        "variants": said,
    }


def _joints(move: Move, robot_name: str) -> dict[str, Any]:
    robot = robots.load(robot_name)
    joints = joint_targets(robot, move)
    limits = [*robot.joint_limits.tolist(), [0.0, 1.0]]
    return {
        "move": {
            "source": list(move.source),
            "target": list(move.target),
            "begins_held": move.begins_held,
            "ends_held": move.ends_held,
        },
        "joints": joints.tolist(),
        "joints_scaled": robot.scale(joints).tolist(),
        "joint_limits": limits + limits,
    }
