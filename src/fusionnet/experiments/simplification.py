"""7.3: is RetinaNet needed, or would two convolutions do; is RCL needed, or would English do?"""

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
from fusionnet.models.thesis_fusion_config import THESIS_HEADS

WITHOUT_TREE = tuple(name for name in THESIS_HEADS if name != "tree")

_VARIANTS = (
    ("retinanet", "RetinaNet without its losses", "retinanet", "tree", ("tree", "joints")),
    ("cnn", "two convolutions", "cnn", "tree", ("tree", "joints")),
    ("rcl", "RCL, all losses", "retinanet", "tree", THESIS_HEADS),
    ("english", "English, all losses", "retinanet", "english", THESIS_HEADS),
    ("rcl-unlearnt", "RCL, without the Transformer's loss", "retinanet", "tree", WITHOUT_TREE),
    (
        "english-unlearnt",
        "English, without the Transformer's loss",
        "retinanet",
        "english",
        WITHOUT_TREE,
    ),
)


def variants(scale: Scale) -> list[Variant]:
    """Two visions, and two targets with and without the Transformer's loss."""
    return [
        Variant(
            name=name,
            label=label,
            values={"vision": vision, "target": target, "outputs": list(outputs)},
        )
        for name, label, vision, target, outputs in _VARIANTS
    ]


def run(trial: Trial) -> Outcome:
    """Train one of them, and measure it."""
    values = trial.variant.values
    tree = "rcl" if trial.scale == "thesis" else "short"
    config = fusion_config(
        trial,
        vision=values["vision"],
        writes="english" if values["target"] == "english" else tree,
        outputs=tuple(values["outputs"]),
        loss_weights=dict.fromkeys(values["outputs"], 1.0),
    )
    return run_fusion(trial, config)


EXPERIMENT = Experiment(
    name="simplification",
    section="7.3",
    title="Simplification: a plain CNN for RetinaNet, English for RCL",
    question="Does the joints' error owe anything to RetinaNet, or to RCL as what is written?",
    setup="FusionNet's base model with two convolutions (16 filters of 3x3, 16 of 4x4, each with "
    "pooling) in place of RetinaNet, both without RetinaNet's losses; and with the sentence "
    "itself in place of its tree as the Transformer's target, with all losses and without the "
    "Transformer's; three repetitions.",
    differs=DIFFERS,
    metric="joint_mse",
    lower_is_better=True,
    variants=variants,
    run=run,
    seeds={"smoke": 1, "small": 5, "thesis": 5},
    published=(
        Published(
            variant="retinanet", metric="joint_mse", mean=0.0351, deviation=0.00136, where="7.3.2"
        ),
        Published(variant="cnn", metric="joint_mse", mean=0.0356, deviation=0.004, where="7.3.2"),
        Published(variant="rcl", metric="joint_mse", mean=0.0372, deviation=0.00191, where="7.3.2"),
        Published(
            variant="english", metric="joint_mse", mean=0.0376, deviation=0.00415, where="7.3.2"
        ),
        Published(
            variant="rcl-unlearnt", metric="joint_mse", mean=0.035, deviation=0.0007, where="7.3.2"
        ),
        Published(
            variant="english-unlearnt",
            metric="joint_mse",
            mean=0.0374,
            deviation=0.00163,
            where="7.3.2",
        ),
    ),
    claims=(
        Claim(better="retinanet", worse="cnn", says="RetinaNet is better than two convolutions."),
        Claim(better="rcl", worse="english", says="Writing RCL is better than writing English."),
        Claim(
            better="rcl-unlearnt",
            worse="english-unlearnt",
            says="RCL is better than English as well where the Transformer's loss is left out.",
        ),
    ),
    figures=(
        Figure(
            kind="bars",
            like="figures 7.3 and 7.4",
            y_label="MSE of the scaled joints, true target given",
        ),
    ),
    caution="The true target is given to the decoder, as in the thesis: with RCL that tells the "
    "network the sentence's meaning for nothing, with English only the sentence again. So the "
    "comparison says as much of what was given as of what was learnt.",
)
