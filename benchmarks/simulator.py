"""How fast the simulator is, against named rivals, and whether it repeats and leaks.

    python benchmarks/simulator.py --only episodes kinematics images memory --out FILE

Each part prints one JSON line, and replaces its part of FILE. A speed is given as a ratio to a
rival that is measured in turns with it in the same run, so that a busy machine slows both.
"""

import copy
import hashlib
import json
import multiprocessing
import resource
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mink
import mujoco
import numpy as np
import tyro

from fusionnet import robots
from fusionnet.blocks import Layout, Move, move_between, random_layout
from fusionnet.corpora import load_corpus
from fusionnet.files import write_whole
from fusionnet.provenance import provenance
from fusionnet.randomness import generator
from fusionnet.robots import ArmKinematics
from fusionnet.simulation import Appearance, SceneRenderer, joint_targets, make_world
from fusionnet.simulation.inverse_kinematics import InverseKinematics
from fusionnet.simulation.posture import robot_posture
from fusionnet.simulation.scenery import add_blocks, add_furniture, picture_model, set_lights
from fusionnet.simulation.tabletop import ideal_poses


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to measure.

    Attributes:
        only: Parts.
        episodes: How many episodes for speed.
        leak: Episodes over which memory is watched, and which must repeat.
        solves: Inverse kinematics.
        images: Pictures of each renderer.
        seed: Everything random derives from it.
        robot: Who acts.
        out: A file that keeps each part that was measured.
    """

    only: tuple[str, ...] = ("episodes", "kinematics", "images", "memory")
    episodes: int = 50
    leak: int = 1000
    solves: int = 300
    images: int = 60
    seed: int = 0
    robot: str = "nico"
    out: Path | None = None


def jobs(config: Config, count: int) -> list[tuple[str, Layout, Move]]:
    """Moves of the example scenes, over and over."""
    scenes = load_corpus("examples").scenes.values()
    pairs = [(s.before, move_between(s.before, s.after)) for s in scenes]
    known = [(config.robot, before, move) for before, move in pairs if move is not None]
    return [known[i % len(known)] for i in range(count)]


def episode(job: tuple[str, Layout, Move]) -> tuple[float, float]:
    """Processor seconds and simulated seconds of one episode."""
    robot, layout, move = job
    begin = time.process_time()
    world = make_world(robot, layout=layout)
    done = world.execute(joint_targets(robot, move))
    used = time.process_time() - begin
    return used, done.seconds


def episodes(config: Config) -> dict[str, Any]:
    """Episodes a second of one core, without pictures."""
    used, simulated = zip(*map(episode, jobs(config, config.episodes)), strict=True)
    return {
        "episodes": config.episodes,
        "episodes_per_core_second": round(len(used) / sum(used), 2),
        "times_real_time": round(sum(simulated) / sum(used), 1),
    }


def kinematics(config: Config) -> dict[str, Any]:
    """Ours (several starts, tilt limit, typed failure) against mink's loop alone."""
    robot = robots.load(config.robot)
    rng = generator(config.seed, "kinematics")
    cells = rng.integers(0, 8, (config.solves, 3))
    targets = [robot.pinch_position(cell) + rng.uniform(-0.01, 0.01, 3) for cell in cells]
    ours, start = InverseKinematics(robot), robot.poses["ready"]
    arm = ArmKinematics(robot)
    configuration = mink.Configuration(arm.model)
    task = mink.FrameTask("pinch", "site", position_cost=100.0, orientation_cost=0.0)
    limits = [mink.ConfigurationLimit(arm.model)]
    joints = [arm.model.joint(name).qposadr[0] for name in robot.joint_names]
    seconds = {"ours": 0.0, "mink": 0.0}
    reached = {"ours": 0, "mink": 0}
    for target in targets:
        begin = time.process_time()
        found = ours.solve(target, start=start)
        seconds["ours"] += time.process_time() - begin
        miss = np.linalg.norm(arm.robot_from_pinch(found)[:3, 3] - target)
        reached["ours"] += int(miss < 1e-4)

        begin = time.process_time()
        pose = np.eye(4)
        pose[:3, 3] = target
        task.set_target(mink.SE3.from_matrix(pose))
        values = configuration.q.copy()
        values[joints] = start
        configuration.update(values)
        miss = np.inf
        for _ in range(60):
            miss = float(np.linalg.norm(task.compute_error(configuration)[:3]))
            if miss < 1e-5:
                break
            velocity = mink.solve_ik(
                configuration, [task], 1.0, "daqp", damping=1e-3, limits=limits
            )
            configuration.integrate_inplace(np.clip(velocity, -0.5, 0.5), 1.0)
        seconds["mink"] += time.process_time() - begin
        reached["mink"] += int(miss < 1e-4)
    table = time.process_time()
    for cell in cells:
        robot.joint_angles(cell)
    table = time.process_time() - table
    return {
        "solves": config.solves,
        "solves_per_second": {n: round(config.solves / s, 1) for n, s in seconds.items()},
        "ratio_to_mink_alone": round(seconds["mink"] / seconds["ours"], 3),
        "within_0.1_mm": {n: round(r / config.solves, 4) for n, r in reached.items()},
        "table_lookups_per_second": round(config.solves / table),
    }


def images(config: Config) -> dict[str, Any]:
    """Processor time of pictures: ours against `mujoco.Renderer` with MuJoCo's default quality.

    Both draw the same robot, lights, table, board and blocks.
    """
    size = (960, 540)
    layout = random_layout(generator(config.seed, "images"))
    ours = SceneRenderer(config.robot, size)
    robot, look = ours.robot, Appearance()
    model = copy.copy(picture_model(config.robot, size))
    default = mujoco.MjModel.from_xml_string("<mujoco/>").vis.quality
    for setting in ("shadowsize", "offsamples", "numslices", "numstacks"):
        setattr(model.vis.quality, setting, getattr(default, setting))
    data = mujoco.MjData(model)
    data.qpos[:] = robot_posture(model, robot, layout)
    mujoco.mj_forward(model, data)
    rival = mujoco.Renderer(model, size[1], size[0], max_geom=2000)
    poses = ideal_poses(layout.blocks, robot.robot_from_board)

    def draw_by_default() -> np.ndarray:
        rival.update_scene(data, camera="left_eye")
        set_lights(rival.scene, look, robot.robot_from_board)
        add_furniture(rival.scene, robot, look)
        add_blocks(rival.scene, model, layout.blocks, poses, look.block_tints)
        return rival.render()

    ways = {
        "mujoco_default": draw_by_default,
        "ours": lambda: ours.view(layout, labels=False).image,
        "ours_with_boxes": lambda: ours.view(layout).image,
        "ours_with_masks_and_depth": lambda: ours.view(layout, masks=True, depth=True).image,
    }
    seconds = dict.fromkeys(ways, 0.0)
    # The first picture of each loads its shapes; nearly the same picture must come out of both.
    first = [way().astype(float) for way in ways.values()]
    difference = float(np.abs(first[0] - first[1]).mean())
    for _ in range(config.images):
        for name, way in ways.items():
            begin = time.process_time()
            way()
            seconds[name] += time.process_time() - begin
    rival.close()
    return {
        "size": size,
        "blocks": len(layout.blocks),
        "shadow_map": {"mujoco_default": default.shadowsize, "ours": 1024},
        "samples": {"mujoco_default": default.offsamples, "ours": 0},
        "mean_difference_of_a_pixel": round(difference, 2),
        "milliseconds": {n: round(1000 * s / config.images, 1) for n, s in seconds.items()},
        "times_as_fast_as_mujoco_default": {
            n: round(seconds["mujoco_default"] / s, 2) for n, s in seconds.items()
        },
    }


def watched(work: list[tuple[str, Layout, Move]]) -> tuple[list[float], list[str]]:
    """Resident MiB of this process after each tenth of the episodes; a hash of each's states."""
    page = resource.getpagesize()
    resident, hashes = [], []
    for index, (robot, layout, move) in enumerate(work):
        done = make_world(robot, layout=layout).execute(joint_targets(robot, move), record=True)
        states = done.recording
        assert states is not None
        arrays = (states.postures, states.positions, states.rotations)
        hashes.append(hashlib.sha256(b"".join(a.tobytes() for a in arrays)).hexdigest())
        if (index + 1) % max(1, len(work) // 10) == 0:
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            resident.append(round(pages * page / 2**20, 1))
    return resident, hashes


def memory(config: Config) -> dict[str, Any]:
    """Memory while episodes follow each other, in two processes at once and in one.

    The states (25 a second: arm, fingers, blocks) of each episode must be the same in both.
    """
    work = jobs(config, config.leak)
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        shared = pool.map(watched, [work[0::2], work[1::2]], chunksize=1)
    resident, hashes = watched(work)
    growth = [round(seen[-1] / seen[0] - 1.0, 4) for seen, _ in (*shared, (resident, hashes))]
    return {
        "episodes": config.leak,
        "resident_mib": {
            "two_processes": [seen for seen, _ in shared],
            "one_process": resident,
        },
        "growth_after_the_first_tenth": {"two_processes": growth[:2], "one_process": growth[2]},
        "identical_trajectories": hashes[0::2] == shared[0][1] and hashes[1::2] == shared[1][1],
    }


def main(config: Config) -> None:
    parts = {f.__name__: f for f in (episodes, kinematics, images, memory)}
    around = {"robot": config.robot, "seed": config.seed, **provenance()}
    for name in config.only:
        begin = time.perf_counter()
        found = parts[name](config)
        took = round(time.perf_counter() - begin, 1)
        command = f"python benchmarks/simulator.py --only {name} --seed {config.seed}"
        part = {"command": command, **found, **around, "seconds": took}
        print(json.dumps({"part": name, **part}), flush=True)
        if config.out is not None:
            kept = json.loads(config.out.read_text()) if config.out.exists() else {}
            write_whole(config.out, json.dumps({**kept, name: part}, indent=1) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Config))
