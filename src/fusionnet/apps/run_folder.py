"""The folder that a run leaves: pictures, tree, joint angles, video, numbers, and a page."""

import json
from pathlib import Path

from PIL import Image

from fusionnet import rcl, robots
from fusionnet.apps.drawing import draw_boxes
from fusionnet.apps.output_folder import RESULT_FILE, written_whole
from fusionnet.apps.page import page
from fusionnet.apps.run_record import RunRecord
from fusionnet.apps.tree_drawing import draw_tree

FILES = (
    "picture.png",
    "boxes.png",
    "tree.txt",
    "tree.png",
    "joint_angles.json",
    "episode.mp4",
    "index.html",
)
"""What a run's folder holds beside result.json; no tree.png where no tree was written."""


def write_folder(record: RunRecord, out: Path) -> None:
    """Write the folder of a run, whole or not at all.

    Raises:
        OutputError: If the disk is full or the folder cannot be written.
    """
    answer, robot = record.answer, robots.load(record.robot)
    with written_whole(out) as folder:
        Image.fromarray(record.picture).save(folder / "picture.png")
        seen = draw_boxes(record.picture, record.boxes)
        Image.fromarray(seen).save(folder / "boxes.png")
        text = f"{record.sentence}\n\n{answer.understood}\n"
        tree_svg = None
        if answer.tree is not None:
            text += f"\n{rcl.outline(answer.tree)}\n\n{rcl.format(answer.tree)}\n"
            draw_tree(answer.tree, record.words, folder / "tree.png", folder / "tree.svg")
            tree_svg = (folder / "tree.svg").read_text(encoding="utf-8")
            (folder / "tree.svg").unlink()
        (folder / "tree.txt").write_text(text, encoding="utf-8")
        joints = {
            "joints": list(robot.joint_names),
            "units": robot.joint_units,
            "grasp": [float(a) for a in answer.grasp.joint_angles],
            "grasp_gripper": float(answer.grasp.gripper),
            "place": [float(a) for a in answer.place.joint_angles],
            "place_gripper": float(answer.place.gripper),
        }
        (folder / "joint_angles.json").write_text(json.dumps(joints, indent=1) + "\n")
        record.episode.video(folder / "episode.mp4")
        video = (folder / "episode.mp4").read_bytes()
        document = record.as_json([n for n in FILES if n != "tree.png" or answer.tree is not None])
        html = page(record, seen=seen, tree_svg=tree_svg, video=video, document=document)
        (folder / "index.html").write_text(html, encoding="utf-8")
        result = json.dumps(document, indent=1, allow_nan=False)
        (folder / RESULT_FILE).write_text(result + "\n", encoding="utf-8")
