import json
import shutil
from functools import partial
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from PIL import Image
from pycocotools.coco import COCO

from dataset_fixtures import SIZE, small_plan, small_sources
from fusionnet.apps.cli import main
from fusionnet.blocks import CLASS_NAMES
from fusionnet.dataset import export_coco as export
from fusionnet.dataset.build import build
from fusionnet.dataset.check import check, sample_faults
from fusionnet.dataset.contact_sheet import CAPTION, TILE, contact_sheet
from fusionnet.dataset.export_coco import export_coco
from fusionnet.dataset.export_lerobot import VIDEO, export_lerobot
from fusionnet.dataset.folder import read_plan
from fusionnet.dataset.masks import decode_mask
from fusionnet.dataset.reader import StoredSamples
from fusionnet.dataset.shards import write_shard
from fusionnet.errors import DataError, InputError, OutputError, UnknownNameError
from fusionnet.simulation.renderer import shared_renderer


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    sources = small_sources(tmp_path_factory.mktemp("sources"))
    folder = tmp_path_factory.mktemp("data") / "set"
    build(folder, small_plan(sources), sources)
    return folder


def test_a_good_data_set_has_no_faults(built, capsys):
    assert check(built) == []
    assert main(["dataset", "check", str(built), "--checksums-only"]) == 0
    assert "no faults" in capsys.readouterr().out


def test_a_damaged_byte_and_a_missing_shard_are_named(built, tmp_path, capsys):
    folder = shutil.copytree(built, tmp_path / "set")
    file = folder / "data" / "train-00000-of-00003.parquet"
    content = bytearray(file.read_bytes())
    content[5000] ^= 1
    file.write_bytes(content)
    (folder / "data" / "sim-00000-of-00001.parquet").unlink()
    assert main(["dataset", "check", str(folder)]) == 2
    said = capsys.readouterr().out
    assert "train-00000-of-00003.parquet is damaged (its checksum is another one); delete" in said
    assert "sim-00000-of-00001.parquet is missing; build" in said and "2 faults" in said


SPOILED = {
    "Box 0 is": lambda s: s["boxes"][0].__setitem__(0, 1.0),
    "the class of box 0": lambda s: s["classes"].__setitem__(0, (s["classes"][0] + 1) % 16),
    "no JPEG of": lambda s: s["image"].__setitem__("bytes", b"\xff\xd8nothing"),
    "no JPEG of 320 x 180": lambda s: s["image"].__setitem__("bytes", b""),
    "cover 7 pixels": lambda s: s["masks"].__setitem__(0, [3, 4]),
    "as many classes": lambda s: s["classes"].pop(),
    "blocks are not those": lambda s: s["block_cells"].reverse(),
    "does not lead": lambda s: s.__setitem__("after", s["before"]),
    "joint values are not": lambda s: s["joints"].__setitem__(2, 0.0),
    "do not fit the limits": lambda s: s["joints_scaled"].__setitem__(2, 0.0),
    "means something else": lambda s: s["variants"][1].__setitem__(
        "tree", "(event: (action: take) (entity: (type: prism)))"
    ),
    "does not belong to val": lambda s: s.__setitem__("group", 1),
    "camera 'room-0' does not": lambda s: s["camera"].__setitem__("name", "room-0"),
}


@pytest.mark.parametrize("what", SPOILED)
def test_a_label_that_contradicts_is_named(built, what):
    plan, sample = read_plan(built), StoredSamples(built, "val")[0]
    assert list(sample_faults(sample, plan, "val")) == []
    SPOILED[what](sample)
    try:
        said = " ".join(sample_faults(sample, plan, "val"))
    except ValueError as error:
        said = str(error)
    assert what.lower() in said.lower()


def test_a_spoiled_sample_is_named_in_its_shard(built, tmp_path):
    folder = shutil.copytree(built, tmp_path / "set")
    samples = [dict(s) for s in StoredSamples(folder, "train")][:5]
    samples[2]["masks"] = samples[2]["masks"][1:]
    name = "data/train-00000-of-00003.parquet"
    record = write_shard(folder, name, samples)
    sums = json.loads((folder / "checksums.json").read_text())
    sums[name] = {k: v for k, v in record.as_json().items() if k != "file"}
    (folder / "checksums.json").write_text(json.dumps(sums))
    (fault,) = check(folder)
    assert fault.sample == "train-00000002" and "as many classes or masks" in fault.what


def test_a_contact_sheet_shows_boxes_in_the_blocks_colours(built, tmp_path):
    samples = list(StoredSamples(built, "train"))
    sheet = contact_sheet(samples[:5], columns=4)
    assert sheet.shape == (2 * (TILE[1] + CAPTION), 4 * TILE[0], 3)
    left, top = samples[0]["boxes"][0][:2]
    x, y = round(left * TILE[0] / SIZE[0]) - 1, round(top * TILE[1] / SIZE[1]) + 2
    assert sheet[y, x].tolist() == [0, 0, 0]
    with pytest.raises(DataError, match="picture of sample train-00000000 is damaged"):
        contact_sheet([samples[0] | {"image": {"bytes": b""}}])
    out = tmp_path / "sheet.png"
    assert main(["dataset", "show", str(built), "--samples", "2", "--out", str(out)]) == 0
    with Image.open(out) as picture:
        assert picture.size == (2 * TILE[0], TILE[1] + CAPTION)


def test_a_strangers_ids_name_no_files(tmp_path, monkeypatch):
    monkeypatch.setattr(export, "read_plan", lambda folder: SimpleNamespace(counts=[("val", 2)]))
    picture = {"image": {"bytes": b"jpeg"}, "width": 4, "height": 3, "sentence": "go"}
    boxes = dict.fromkeys(("boxes", "classes", "masks", "box_blocks"), ())
    ids = (str(tmp_path / "absolute"), "../../../beside")
    samples = [{"id": name, **picture, **boxes} for name in ids]
    monkeypatch.setattr(export, "StoredSamples", lambda folder, split: samples)
    export_coco(tmp_path, tmp_path / "coco")
    written = {str(file.relative_to(tmp_path)) for file in tmp_path.rglob("*.jpg")}
    assert written == {f"coco/images/val/val-{number:08d}.jpg" for number in (0, 1)}


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # pycocotools
def test_cocos_own_reader_reads_the_export(built, tmp_path):
    out = tmp_path / "coco"
    export_coco(built, out, ["train"])
    coco = COCO(out / "annotations" / "instances_train.json")
    samples = StoredSamples(built, "train")
    assert len(coco.imgs) == 12
    assert [coco.cats[i + 1]["name"] for i in range(16)] == list(CLASS_NAMES)
    for number, sample in enumerate(samples, 1):
        with Image.open(out / "images" / coco.imgs[number]["file_name"]) as picture:
            assert picture.size == SIZE
        found = coco.loadAnns(coco.getAnnIds(imgIds=number))
        assert [a["category_id"] - 1 for a in found] == sample["classes"]
        for annotation, lengths in zip(found, sample["masks"], strict=True):
            mask = decode_mask(lengths, SIZE)
            np.testing.assert_array_equal(coco.annToMask(annotation), mask)
            left, top, width, height = annotation["bbox"]
            assert mask[int(top) : int(top + height), int(left) : int(left + width)].sum() == (
                mask.sum()
            )
            assert annotation["area"] == mask.sum()
    captions = COCO(out / "annotations" / "captions_train.json")
    assert captions.anns[1]["caption"] == samples[0]["sentence"]
    with pytest.raises(OutputError, match="holds files already"):
        export_coco(built, out)
    with pytest.raises(UnknownNameError, match="no split 'trian'"):
        export_coco(built, tmp_path / "none", ["trian"])


def test_episodes_are_not_for_coco(tmp_path, capsys):
    words = ["dataset", "export", "coco", str(tmp_path), str(tmp_path / "out"), "--episodes", "5"]
    assert main(words) == 2
    assert "--episodes is for LeRobot" in capsys.readouterr().err


def test_episodes_are_a_lerobot_data_set(built, tmp_path, monkeypatch):
    out = tmp_path / "lerobot"
    for module in ("fusionnet.simulation.video", "fusionnet.dataset.export_lerobot"):
        small = partial(shared_renderer, size=(160, 88))
        monkeypatch.setattr(f"{module}.shared_renderer", small)
    counted = export_lerobot(built, out, "train", episodes=1)
    info = json.loads((out / "meta" / "info.json").read_text())
    assert info["codebase_version"] == "v3.0" and info["total_episodes"] == 1
    place = {"chunk_index": 0, "file_index": 0}
    rows = pq.read_table(out / info["data_path"].format(**place)).to_pydict()
    stored = {name for name, f in info["features"].items() if f["dtype"] != "video"}
    assert set(rows) == stored
    length = counted["frames"]
    assert len(rows["index"]) == length == info["total_frames"]
    state, action = np.array(rows["observation.state"]), np.array(rows["action"])
    assert state.shape == (length, 7)
    np.testing.assert_array_equal(state[1:], action[:-1])
    assert np.allclose(np.diff(rows["timestamp"]), 1 / info["fps"], atol=1e-4)
    grasp = np.array(StoredSamples(built, "train")[0]["joints"][:6])
    assert np.abs(state[:, :6] - grasp).max(axis=1).min() < 0.05  # the arm came by the grasp pose
    assert rows["next.success"][-1] == bool(counted["succeeded"])
    (episode,) = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert (episode["dataset_from_index"], episode["dataset_to_index"]) == (0, length)
    assert episode[f"videos/{VIDEO}/to_timestamp"] == pytest.approx(length / info["fps"])
    assert episode["tasks"] == [StoredSamples(built, "train")[0]["sentence"]]
    tasks = pd.read_parquet(out / "meta" / "tasks.parquet")
    assert tasks.loc[episode["tasks"][0]].task_index == 0
    stats = json.loads((out / "meta" / "stats.json").read_text())
    assert set(stats) == set(info["features"])
    assert np.shape(stats[VIDEO]["mean"]) == (3, 1, 1)
    film = out / info["video_path"].format(video_key=VIDEO, **place)
    assert film.stat().st_size > 10_000
    with pytest.raises(InputError, match="At least one episode"):
        export_lerobot(built, tmp_path / "none", "train", episodes=0)
