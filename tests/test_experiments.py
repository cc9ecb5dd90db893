import dataclasses
import itertools
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np
import optuna
import pytest
import torch

from fusionnet import experiments
from fusionnet.apps.cli import main
from fusionnet.blocks import plan as planned
from fusionnet.corpora import load_corpus
from fusionnet.errors import CheckpointError, DataError, InputError, UnknownNameError
from fusionnet.experiments import (
    Outcome,
    Plan,
    Trial,
    Variant,
    _thesis_fusion,
    ablation,
    conflict,
    final_model,
    judge,
    of_one_setup,
    read_records,
    reproduce,
    require,
    summaries,
    weightings,
)
from fusionnet.experiments._fusion import fusion_config, train_fusion
from fusionnet.experiments._locks import Lock, alone
from fusionnet.experiments._pointing_task import CELLS, PointingSet
from fusionnet.files import write_whole
from fusionnet.report.chapters import chapter
from fusionnet.report.tables import notes
from fusionnet.training.thesis_fusion_config import ThesisFusionConfig
from toy_experiment import STEPS, run, toy

TOY = Path(__file__).parent / "toy_experiment.py"


def made(folder: Path, scale: str = "smoke") -> Counter:
    return Counter((folder / "work" / scale / "made.txt").read_text().splitlines())


def plan(folder: Path, **values) -> Plan:
    return Plan(
        **{"scale": "smoke", "results": folder / "results", "work": folder / "work", **values}
    )


def test_every_variant_is_run_with_every_seed_once(tmp_path):
    seen = []
    records = reproduce(toy(), plan(tmp_path), progress=lambda done, of: seen.append((done, of)))
    assert len(records) == 6 and seen[-1] == (6, 6)
    again = reproduce(toy(), plan(tmp_path))
    assert {(r.variant.name, r.seed) for r in again} == {
        (f"x{x}", s) for x in (1, 2, 3) for s in (0, 1)
    }
    assert max(made(tmp_path).values()) == 1
    reproduce(toy(), plan(tmp_path, again=True))
    assert set(made(tmp_path).values()) == {2}


def test_a_record_says_where_it_comes_from(tmp_path):
    reproduce(toy(), plan(tmp_path, seeds=1))
    file = tmp_path / "results" / "toy" / "smoke" / "x1-seed0.json"
    stored = json.loads(file.read_text())
    assert stored["provenance"]["versions"]["torch"] and stored["provenance"]["cores"]
    assert stored["command"] == "fusionnet reproduce toy --scale smoke"
    assert stored["configuration"] == {"slope": 2.0}
    assert stored["curves"] == {"loss": [1.0, 0.5]} and stored["seconds"] >= 0
    file.write_text(file.read_text()[:100])
    with pytest.raises(DataError, match="x1-seed0.json is not a whole record"):
        read_records(tmp_path / "results", "toy", "smoke")


def test_claims_are_judged_by_paired_seeds(tmp_path):
    records = reproduce(toy(), plan(tmp_path, scale="small"))
    judged = [judge(toy(), claim, records) for claim in toy().claims]
    assert [j.verdict for j in judged] == ["agrees", "differs", "cannot tell"]
    assert judged[0].difference is not None and judged[0].difference.seeds == 5
    best = min(summaries(records, "error"), key=lambda s: s.mean)
    assert best.variant.name == "x2" and best.low <= best.mean <= best.high


def test_two_processes_share_a_search_and_one_is_killed(tmp_path):
    run = [sys.executable, str(TOY), str(tmp_path), "6"]
    environment = {**os.environ, "TOY_SECONDS": "0.15"}
    first, second = (subprocess.Popen(run, env=environment) for _ in range(2))
    log = tmp_path / "work" / "smoke" / "made.txt"
    deadline = time.monotonic() + 60
    while not log.is_file() or log.read_text().count("proposal") < 3:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    first.send_signal(signal.SIGKILL)
    first.wait()
    assert second.wait(timeout=60) == 0
    records = reproduce(toy(trials=6), plan(tmp_path))
    proposals = {r.variant.name for r in records if "proposal" in r.variant.name}
    assert len(proposals) == 6 and len(records) == 6 + 6 * 2
    # Only the run that the killed process was at may have been begun twice.
    assert sum(count - 1 for count in made(tmp_path).values()) <= 1
    study = optuna.load_study(
        study_name="toy",
        storage=optuna.storages.JournalStorage(
            optuna.storages.journal.JournalFileBackend(
                str(tmp_path / "results" / "toy" / "smoke" / "study.journal")
            )
        ),
    )
    assert not study.get_trials(states=[optuna.trial.TrialState.RUNNING])


def test_an_unknown_experiment_lists_what_there_is(capsys):
    with pytest.raises(UnknownNameError, match="No experiment called 'ablatoin'"):
        experiments.load("ablatoin")
    assert main(["reproduce", "ablatoin"]) == 2
    assert "available:" in capsys.readouterr().err


def test_missing_data_or_weights_name_the_command(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["reproduce", "data_amount", "--scale", "small", "--seeds", "1"]) == 2
    said = capsys.readouterr().err
    assert "fusionnet reproduce data_amount --scale small --data DIR" in said
    assert not list((tmp_path / "results").rglob("*.json"))
    trial = Trial(experiment="toy", variant=Variant(name="x", values={}), seed=0, scale="small")
    with pytest.raises(DataError, match="`fusionnet train detector` makes it"):
        require(tmp_path / "detector", trial, "fusionnet train detector")
    assert require(tmp_path, trial, "nothing") == tmp_path


def test_all_goes_on_past_an_experiment_without_data(tmp_path, capsys, monkeypatch):
    without = dataclasses.replace(toy(), name="without", run=needs_data)
    there = {"toy": toy(), "without": without}
    monkeypatch.setattr(experiments, "load", there.__getitem__)
    monkeypatch.setattr(experiments, "names", lambda: ["without", "toy"])
    monkeypatch.chdir(tmp_path)
    assert main(["reproduce", "all", "--scale", "smoke", "--seeds", "1"]) == 2
    said = capsys.readouterr()
    assert "`make data` makes it" in said.out and "Not run" in said.err and "without." in said.err
    assert len(read_records(Path("results/experiments"), "toy", "smoke")) == 3


def needs_data(trial: Trial) -> Outcome:
    require(Path("nowhere"), trial, "make data")
    raise AssertionError


def test_resume_is_what_happens_anyway_and_again_makes_runs_again(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(experiments, "load", lambda name: toy(trials=2))
    monkeypatch.chdir(tmp_path)
    run = ["reproduce", "toy", "--scale", "smoke", "--seeds", "1"]
    assert main([*run, "--resume"]) == main(run) == 0
    log = Path("runs/reproduce/smoke/made.txt")
    assert set(Counter(log.read_text().splitlines()).values()) == {1}
    assert main([*run, "--again"]) == 0
    assert set(Counter(log.read_text().splitlines()).values()) == {2}
    assert main([*run, "--again", "--resume"]) == 2
    assert "say one" in capsys.readouterr().err


def test_a_killed_run_goes_on_from_its_state(tmp_path):
    run = [sys.executable, str(TOY), str(tmp_path), "0", "steps"]
    process = subprocess.Popen(run, env={**os.environ, "TOY_SECONDS": "0.05"})
    work = tmp_path / "work" / "smoke"
    log = work / "steps.txt"
    deadline = time.monotonic() + 60
    while not log.is_file() or log.read_text().count("x1 0") < 5:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not list((tmp_path / "results").rglob("*.json"))
    assert subprocess.run(run, env=dict(os.environ)).returncode == 0
    counts = Counter(log.read_text().splitlines())
    # It goes on where it was: only the step at which it was killed may have been done twice.
    assert STEPS <= counts["x1 0"] <= STEPS + 1
    assert counts["x2 1"] == STEPS
    assert not list((work / "states").rglob("*.txt"))


def test_some_variants_may_be_run_alone(tmp_path):
    names = [variant.name for variant in toy().variants("smoke")]
    records = reproduce(toy(), plan(tmp_path, seeds=2, only=(names[1],)))
    assert [record.variant.name for record in records] == [names[1]] * 2
    with pytest.raises(UnknownNameError, match=names[0]):
        reproduce(toy(), plan(tmp_path, only=("nothing",)))


def test_some_variants_may_be_made_again_alone(tmp_path):
    everything = reproduce(toy(trials=2), plan(tmp_path))
    before = made(tmp_path)
    reproduce(toy(trials=2), plan(tmp_path, only=("x2",), again=True))
    assert made(tmp_path) - before == Counter(["x2 0", "x2 1"])
    assert len(read_records(tmp_path / "results", "toy", "smoke")) == len(everything)
    reproduce(toy(trials=2), plan(tmp_path))
    assert made(tmp_path) - before == Counter(["x2 0", "x2 1"])


def broken(trial):
    raise DataError("no data")


def test_records_stay_until_they_are_replaced(tmp_path):
    everything = reproduce(toy(trials=2), plan(tmp_path))
    failing = dataclasses.replace(toy(trials=2), run=broken)
    with pytest.raises(DataError, match="no data"):
        reproduce(failing, plan(tmp_path, again=True))
    kept = read_records(tmp_path / "results", "toy", "smoke")
    assert len(kept) == len(everything)
    reproduce(toy(), plan(tmp_path, again=True, only=("x2",), seeds=1))
    assert len(read_records(tmp_path / "results", "toy", "smoke")) == len(kept)


def with_setup(text: str):
    return dataclasses.replace(toy(), differs={"smoke": text})


def test_runs_of_different_setups_do_not_stand_in_one_mean(tmp_path):
    reproduce(with_setup("Ten steps."), plan(tmp_path, only=("x1",)))
    records = reproduce(with_setup("Twenty steps."), plan(tmp_path))
    assert Counter(r.setup for r in records) == {"Ten steps.": 2, "Twenty steps.": 4}
    assert {r.variant.name for r in of_one_setup(records, "Twenty steps.")} == {"x2", "x3"}
    commonest = of_one_setup(records, "Thirty steps.")
    assert {r.setup for r in commonest} == {"Twenty steps."}
    shown = chapter(with_setup("Twenty steps."), tmp_path / "results")
    assert shown.left_out == 2 and {s.variant.name for s in shown.summaries} == {"x2", "x3"}
    assert [j.verdict for j in shown.judgements] == ["not run"] * 3
    assert "2 runs of another set-up are left out" in notes(shown)


def test_the_report_tells_the_setup_that_ran_not_todays(tmp_path):
    reproduce(with_setup("Ten steps."), plan(tmp_path))
    later = chapter(with_setup("Twenty steps."), tmp_path / "results")
    assert "Ten steps." in notes(later) and "Twenty" not in notes(later)
    for file in (tmp_path / "results").rglob("*.json"):  # as records were before
        stored = json.loads(file.read_text())
        del stored["setup"]
        file.write_text(json.dumps(stored))
    assert "Twenty steps." in notes(chapter(with_setup("Twenty steps."), tmp_path / "results"))


def test_runs_of_another_setup_are_told(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(experiments, "load", lambda name: now)
    monkeypatch.chdir(tmp_path)
    run = ["reproduce", "toy", "--scale", "smoke"]
    now = with_setup("Ten steps.")
    assert main(run) == 0 and "another set-up" not in capsys.readouterr().out
    now = with_setup("Twenty steps.")
    assert main(run) == 0
    said = capsys.readouterr().out
    assert "toy: 6 of 6 runs were made with another set-up than today's, 0 are left out" in said
    assert main([*run, "--again"]) == 0 and "another set-up" not in capsys.readouterr().out


def measured_together(trial: Trial) -> Outcome:
    file = trial.shared / f"seed{trial.seed}.json"
    if not file.is_file():
        write_whole(file, json.dumps(run(trial).metrics))
    return Outcome(metrics=json.loads(file.read_text()))


def test_again_measures_again_what_trials_measured_together(tmp_path):
    experiment = dataclasses.replace(toy(), run=measured_together)
    reproduce(experiment, plan(tmp_path))
    reproduce(experiment, plan(tmp_path))
    assert made(tmp_path).total() == 2
    reproduce(experiment, plan(tmp_path, again=True))
    assert made(tmp_path).total() == 4
    reproduce(experiment, plan(tmp_path, again=True, only=("x2",)))
    assert made(tmp_path).total() == 6


@pytest.mark.parametrize("kind", ["thesis", "compact"])
def test_the_cosines_of_all_pairs_are_measured_once_and_again_on_demand(
    tmp_path, monkeypatch, kind
):
    counted = Counter()

    def measure(trial: Trial) -> conflict.Cosines:
        counted[kind] += 1
        found = conflict.Cosines(torch.nn.Linear(1, 1), (), 1)
        pairs = ["-".join(p) for p in itertools.combinations(conflict.LOSSES[kind], 2)]
        found.found, found.shared = dict.fromkeys(pairs, [0.5]), dict.fromkeys(pairs, 1)
        return found

    monkeypatch.setattr(conflict, f"_{kind}", measure)
    names = tuple(v.name for v in conflict.variants("smoke") if v.name.startswith(kind))
    for again, times in ((False, 1), (False, 1), (True, 2)):
        reproduce(conflict.EXPERIMENT, plan(tmp_path, only=names, again=again))
        assert counted[kind] == times


def test_what_is_done_alone_waits_for_another_process(tmp_path):
    done = threading.Event()

    def work() -> None:
        with alone(tmp_path, Path("what")):
            done.set()

    lock = Lock(tmp_path, Path("what"))
    assert lock.acquire()
    waiting = threading.Thread(target=work)
    waiting.start()
    assert not done.wait(0.3)
    lock.release()
    assert done.wait(10)
    waiting.join()


def test_two_processes_need_the_fusion_set_and_each_checks_it_alone(tmp_path, monkeypatch):
    built, building = [], threading.Lock()

    def build(folder: Path, *_: object, **__: object) -> None:
        assert building.acquire(blocking=False)
        write_whole(folder / "checksums.json", "{}")
        time.sleep(0.3)
        built.append(folder)
        building.release()

    monkeypatch.setattr(_thesis_fusion, "build", build)
    monkeypatch.setattr(_thesis_fusion, "plan_for", lambda *_, **__: None)
    trial = Trial(experiment="t", variant=Variant(name="x", values={}), seed=0, scale="smoke")
    trial = dataclasses.replace(trial, work=tmp_path)
    needing = [threading.Thread(target=_thesis_fusion.fusion_set, args=(trial,)) for _ in range(2)]
    for thread in needing:
        thread.start()
    for thread in needing:
        thread.join()
    assert built == 2 * [tmp_path / "fusion-set"]  # which refuses one of another plan


def test_the_final_models_transformer_is_slowed_by_the_loss_that_it_learns(tmp_path, monkeypatch):
    seen = []

    def stop(config: ThesisFusionConfig, **_: object) -> None:
        seen.append(config.loop)
        raise InterruptedError

    monkeypatch.setattr(_thesis_fusion, "fusion_set", lambda trial: tmp_path)
    monkeypatch.setattr(final_model.thesis_fusion, "run", stop)
    final = next(v for v in final_model.variants("smoke") if v.name == "final")
    trial = Trial(experiment="final_model", variant=final, seed=0, scale="smoke", work=tmp_path)
    with pytest.raises(InterruptedError):
        final_model.run(trial)
    assert seen[0].loss_weights[seen[0].schedule.monitor] > 0


def test_a_state_is_not_resumed_under_other_settings_nor_kept_where_it_is_not_wanted(tmp_path):
    trial = Trial(experiment="t", variant=Variant(name="x", values={}), seed=0, scale="smoke")
    trial = dataclasses.replace(trial, work=tmp_path)
    learnt = experiments.corpus_for(trial).split("train")[:20]
    train_fusion(learnt, fusion_config(1, 0, 2, save_every=1), trial, resumed=False)
    assert not list(tmp_path.rglob("*.safetensors"))
    train_fusion(learnt, fusion_config(1, 0, 2, save_every=1), trial)
    assert list(trial.state.rglob("*.safetensors"))
    with pytest.raises(CheckpointError, match="learning_rate"):
        train_fusion(learnt, fusion_config(2, 0, 2, save_every=1, learning_rate=0.01), trial)


def test_a_training_whose_time_is_measured_leaves_no_state_to_resume(tmp_path, monkeypatch):
    def stop(*_: object) -> None:
        raise InterruptedError

    monkeypatch.setattr(weightings, "acted_on", stop)
    monkeypatch.setattr(weightings, "fusion_config", partial(fusion_config, save_every=1))
    variant = weightings.variants("smoke")[0]
    trial = Trial(experiment="t", variant=variant, seed=0, scale="smoke", work=tmp_path)
    with pytest.raises(InterruptedError):
        weightings.run(trial)
    assert not trial.state.exists()


def test_no_seeds_are_refused():
    with pytest.raises(InputError, match="At least one seed"):
        Plan(seeds=0)


def test_a_block_that_falls_into_its_cell_counts_though_it_was_placed_too_high():
    command = load_corpus("examples").commands[0]
    move = planned(command.tree, command.scene.before)
    high = move.target._replace(z=move.target.z + 1)
    source, target, higher = np.searchsorted(
        CELLS, [c.index for c in (move.source, move.target, high)]
    )
    tested = PointingSet(
        commands=(command,),
        pictures=np.zeros((1, 1, 1, 3), np.uint8),
        pixels=np.zeros((len(CELLS), 1, 2)),
        cells=np.zeros((1, len(CELLS)), int),
        source=np.array([source]),
        target=np.array([target]),
        sentences=[],
        trees=[],
    )
    acted = ablation._acted(tested, np.array([[source, higher]]))
    assert acted["executed_success"] == acted["grasp_right"] == 1.0
    assert acted["cells_right"] == acted["place_right"] == 0.0 < acted["joint_error_degrees"]


@pytest.mark.parametrize("name", experiments.names())
def test_every_experiment_is_described_whole(name):
    experiment = experiments.load(name)
    assert experiment.name == name and experiment.setup and experiment.question
    for scale in ("smoke", "small", "thesis"):
        variants = [v.name for v in experiment.variants(scale)]
        assert len(set(variants)) == len(variants)
        assert experiment.seeds[scale] >= 1
    everything = {v.name for v in experiment.variants("thesis")}
    for claim in experiment.claims:
        assert {claim.better, claim.worse} <= everything, claim
    assert {p.variant for p in experiment.published} <= everything
