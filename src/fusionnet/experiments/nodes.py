"""7.4: how many nodes should connect RetinaNet and the Transformer to FusionNet?"""

from fusionnet.experiments._experiment import (
    Claim,
    Experiment,
    Figure,
    Outcome,
    Published,
    Scale,
    Trial,
    Variant,
)
from fusionnet.experiments._thesis_fusion import DIFFERS, fusion_config, run_fusion

NODES: dict[Scale, tuple[int, ...]] = {
    "smoke": (4, 16),
    "small": (4, 16, 32),
    "thesis": (4, 6, 8, 16, 20, 25, 32),
}


def variants(scale: Scale) -> list[Variant]:
    """One a number of nodes."""
    return [Variant(name=f"n{n}", values={"nodes": n}, label=str(n)) for n in NODES[scale]]


def run(trial: Trial) -> Outcome:
    """Train with so many nodes an anchor and a token, and measure."""
    return run_fusion(trial, fusion_config(trial, nodes=trial.variant.values["nodes"]))


EXPERIMENT = Experiment(
    name="nodes",
    section="7.4",
    title="Nodes: the width of the connection to FusionNet",
    question="Does a wider connection between the modules and FusionNet make the joints more "
    "exact?",
    setup="FusionNet's base model with N_n of 4, 6, 8, 16, 20, 25 and 32 nodes, all losses with "
    "the factor 1; three repetitions each.",
    differs={
        **DIFFERS,
        "small": f"{DIFFERS['small']} Three of the seven numbers of nodes.",
    },
    metric="joint_mse",
    lower_is_better=True,
    variants=variants,
    run=run,
    seeds={"smoke": 1, "small": 5, "thesis": 5},
    published=(
        Published(
            variant="n4", metric="joint_mse", mean=0.0373, deviation=0.0002, where="table A.1"
        ),
        Published(variant="n16", metric="joint_mse", mean=0.0363, deviation=0.0006, where="7.4.2"),
    ),
    claims=(
        Claim(better="n16", worse="n4", says="Sixteen nodes are better than four."),
        Claim(better="n16", worse="n32", says="More than sixteen nodes are worse again."),
    ),
    figures=(
        Figure(
            kind="lines",
            x="nodes",
            like="figure 7.5",
            x_label="nodes an anchor and a token",
            y_label="MSE of the scaled joints, true tree given",
        ),
    ),
)
