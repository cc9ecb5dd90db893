"""What looking again is worth: executed success with displaced blocks and with joint noise.

    python benchmarks/closed_loop.py --data DIR

Makes what is missing of the experiment `closed_loop`, adds up the episodes of all its seeds for
each condition, keeps the numbers and draws them. With and without the closed loop the commands,
looks, displacements and noise are the same, of groups that no network was trained on.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import tyro

from fusionnet.evaluation.intervals import wilson_interval
from fusionnet.experiments import Plan, load, reproduce
from fusionnet.experiments.closed_loop import DISTURBANCES, said_of
from fusionnet.files import write_whole


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to run.

    Attributes:
        data: Folder of the treebank.
        seeds: How many; as the experiment says by default.
        results: Folder of the experiments' records.
        out: The file of numbers.
        figure: The picture.
    """

    data: Path | None = None
    seeds: int | None = None
    results: Path = Path("results/experiments")
    out: Path = Path("results/closed-loop.json")
    figure: Path = Path("docs/images/closed-loop.png")


def main(config: Config) -> None:
    """Measure what is missing, keep and draw."""
    plan = Plan(scale="small", data=config.data, seeds=config.seeds, results=config.results)
    records = reproduce(load("closed_loop"), plan)
    rows = [
        _row(name, [record for record in records if record.variant.name.startswith(f"{name}-")])
        for name in DISTURBANCES
    ]
    settings = records[0].configuration
    document = {
        "command": "python benchmarks/closed_loop.py --data DIR",
        **records[0].provenance,
        "commit": sorted({record.provenance["commit"] for record in records}),
        "corpus": settings["corpus"],
        "split": settings["split"],
        "policy": settings["policy"],
        "checkpoint": settings["checkpoint"],
        "seeds": sorted({record.seed for record in records}),
        "rows": rows,
    }
    write_whole(config.out, json.dumps(document, indent=1) + "\n")
    print(json.dumps(document, indent=1))
    draw(document, config.figure)


def _row(name: str, records: list) -> dict:
    """One condition: success with either loop, and in how many pairs only one of them reached."""
    row: dict = {
        "displaced_mm": DISTURBANCES[name][0],
        "joint_noise_deg": DISTURBANCES[name][1],
        "said": said_of(name),
    }
    reached: dict[str, list[int]] = {}
    for loop in ("open", "closed"):
        mine = sorted(
            (r for r in records if r.variant.name == f"{name}-{loop}"), key=lambda r: r.seed
        )
        reached[loop] = [episode for record in mine for episode in record.details["reached"]]
        outcomes: dict[str, int] = {}
        for record in mine:
            for outcome, count in record.details["outcomes"].items():
                outcomes[outcome] = outcomes.get(outcome, 0) + count
        n, successes = len(reached[loop]), sum(reached[loop])
        low, high = wilson_interval(successes, n)
        row[loop] = {
            "n": n,
            "executed_success": round(successes / n, 4),
            "executed_success_95": [round(low, 4), round(high, 4)],
            "outcomes": outcomes,
        }
    pairs = list(zip(reached["open"], reached["closed"], strict=True))
    row["only_closed_reached"] = pairs.count((0, 1))
    row["only_open_reached"] = pairs.count((1, 0))
    return row


def draw(document: dict, file: Path) -> None:
    """Bars of success with and without the loop, with 95 % intervals (Wilson)."""
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    rows = document["rows"]
    figure, axes = plt.subplots(figsize=(7.2, 3.6), layout="constrained")
    for offset, loop, color, label in (
        (-0.2, "open", "#999999", "looks once"),
        (0.2, "closed", "#0072b2", "looks again"),
    ):
        rates = [100 * row[loop]["executed_success"] for row in rows]
        bounds = [[100 * bound for bound in row[loop]["executed_success_95"]] for row in rows]
        errors = [
            [rate - low for rate, (low, _) in zip(rates, bounds, strict=True)],
            [high - rate for rate, (_, high) in zip(rates, bounds, strict=True)],
        ]
        places = [number + offset for number in range(len(rows))]
        axes.bar(places, rates, 0.38, color=color, label=label, yerr=errors, capsize=3)
        for place, rate in zip(places, rates, strict=True):
            axes.text(place, 3, f"{rate:.0f}", ha="center", color="white", weight="bold")
    axes.set_xticks(range(len(rows)), [row["said"].replace(" and ", "\nand ") for row in rows])
    axes.set_xlabel("blocks displaced by up to 1 cm; standard deviation of every joint's error")
    axes.set_ylabel("executed success [%]")
    axes.set_ylim(0, 118)
    axes.set_yticks(range(0, 101, 20))
    axes.legend(loc="upper right", ncols=2, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    main(tyro.cli(Config, description=__doc__))
