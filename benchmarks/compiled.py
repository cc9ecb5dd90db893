"""Whether a compiled, exported or otherwise lowered detector answers sooner than the eager one.

    python benchmarks/compiled.py --out results/compiled-speed.json

The detector is the slowest stage of an answer. Each way is timed on the same pictures in turns
with the eager network in single precision, so that both meet the same load of the machine; the
ratio is the median over rounds of eager time by its time (above 1: faster). What a way costs
before its first answer, and by how much its probabilities of cells and its pixels of the camera
differ, stands beside. On one thread the processor's own clock counts, which is what the wall's
would show on an idle machine.
"""

import copy
import importlib.util
import json
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import torch
import torch._inductor.config
import tyro
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from fusionnet.dataset.layouts import varied_layout
from fusionnet.files import write_whole
from fusionnet.models.retinanet import RetinaNet
from fusionnet.policy import weights_folder
from fusionnet.provenance import provenance
from fusionnet.randomness import generator
from fusionnet.simulation import Appearance, SceneRenderer

Call = Callable[[Tensor], tuple[Tensor, ...]]


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to measure.

    Attributes:
        checkpoint: A shipped name, or a folder that holds the checkpoint `detector`.
        pictures: So many are looked at by turns.
        rounds: How often each way sees a picture, after two rounds that do not count.
        threads: Numbers of PyTorch's threads.
        ways: Names of the ways; all by default. One that is not installed here is left out.
        seed: Of the pictures.
        out: Where to write the numbers; the terminal only by default.
    """

    checkpoint: str = "compact"
    pictures: int = 5
    rounds: int = 15
    threads: tuple[int, ...] = (1,)
    ways: tuple[str, ...] = ()
    seed: int = 0
    out: Path | None = None


class Tensors(nn.Module):
    """The detector as tensors in, tensors out: what can be traced and exported."""

    def __init__(self, detector: RetinaNet) -> None:
        super().__init__()
        self.detector = detector

    def forward(self, images: Tensor) -> tuple[Tensor, ...]:
        """Logits and offsets of anchors, the camera's deviation, logits of cells and hand."""
        found = self.detector(images)
        return *found["boxes"][:2], found["pose"][-1], found["cells"].logits, found["cells"].held


def eager(network: Tensors, _: Tensor) -> Call:
    """As it is shipped."""
    return network


def channels_last(network: Tensors, _: Tensor) -> Call:
    """Weights of two-dimensional convolutions laid out as the feature maps are."""
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            module.to(memory_format=torch.channels_last)
    return network


def folded(network: Tensors, _: Tensor) -> Call:
    """Normalisations folded into the convolutions before them."""
    for part in network.modules():
        if isinstance(part, nn.Sequential):
            for place in range(len(part) - 1):
                convolution, normalised = part[place], part[place + 1]
                if isinstance(normalised, nn.BatchNorm2d):
                    part[place] = fuse_conv_bn_eval(convolution, normalised)
                    part[place + 1] = nn.Identity()
    return network


def compiled(network: Tensors, _: Tensor) -> Call:
    """torch.compile, inductor, default mode."""
    torch.compiler.reset()
    call: Call = torch.compile(network, dynamic=False)
    return call


def compiled_frozen(network: Tensors, _: Tensor) -> Call:
    """The same with weights as constants, packed for oneDNN."""
    torch.compiler.reset()
    call: Call = torch.compile(network, dynamic=False)

    def patched(images: Tensor) -> tuple[Tensor, ...]:
        with torch._inductor.config.patch(freezing=True):
            return call(images)

    return patched


def traced(network: Tensors, images: Tensor) -> Call:
    """torch.jit.trace, frozen and optimised for inference."""
    with torch.no_grad():
        script = torch.jit.freeze(torch.jit.trace(network, images, check_trace=False))
        call: Call = torch.jit.optimize_for_inference(script)
    return call


def exported(network: Tensors, images: Tensor) -> Call:
    """torch.export: one graph of core operators, no Python of ours."""
    call: Call = torch.export.export(network, (images,)).module()
    return call


def onnx_runtime(network: Tensors, images: Tensor) -> Call:
    """ONNX Runtime, graph optimisations on, as many threads as PyTorch has."""
    import onnxruntime

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "detector.onnx"
        torch.onnx.export(network, (images,), file, dynamo=True, verbose=False)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = torch.get_num_threads()
        session = onnxruntime.InferenceSession(file, options)
    name = session.get_inputs()[0].name
    return lambda given: tuple(map(torch.from_numpy, session.run(None, {name: given.numpy()})))


def compiled_half(network: Tensors, images: Tensor) -> Call:
    """torch.compile with weights as constants, and bfloat16 where autocast allows it."""
    return half(compiled_frozen(network, images), images)


def half(network: Call, _: Tensor) -> Call:
    """bfloat16 where autocast allows it: what `RetinaNet.see` does where that is fast."""

    def call(images: Tensor) -> tuple[Tensor, ...]:
        with torch.autocast("cpu", dtype=torch.bfloat16):
            return network(images)

    return call


WAYS: dict[str, Callable[[Tensors, Tensor], Call]] = {
    "eager again": eager,
    "channels last": channels_last,
    "folded normalisation": folded,
    "bfloat16": half,
    "torch.export": exported,
    "torch.jit.trace, frozen": traced,
    "torch.compile": compiled,
    "torch.compile, frozen": compiled_frozen,
    "torch.compile, frozen, bfloat16": compiled_half,
    "ONNX Runtime": onnx_runtime,
}
NEEDS = {"ONNX Runtime": ("onnxruntime", "onnxscript")}


def main(config: Config) -> None:
    """Prepare each way and time it in turns with the eager network."""
    warnings.simplefilter("ignore")
    detector = RetinaNet.from_folder(weights_folder(config.checkpoint) / "detector")
    pictures = [torch.from_numpy(p)[None] for p in _pictures(detector, config)]
    chosen = config.ways or tuple(
        name for name in WAYS if all(map(importlib.util.find_spec, NEEDS.get(name, ())))
    )
    results: dict[str, Any] = {}
    for threads in config.threads:
        torch.set_num_threads(threads)
        results[f"threads {threads}"] = {
            name: _measured(detector, WAYS[name], pictures, config.rounds) for name in chosen
        }
    report = {
        "command": "python benchmarks/compiled.py",
        "ratios_to_eager": results,
        "ways": {name: way.__doc__ for name, way in WAYS.items() if name in chosen},
        "pictures": config.pictures,
        "rounds": config.rounds,
        "checkpoint": config.checkpoint,
        "seed": config.seed,
        **provenance(),
    }
    text = json.dumps(report, indent=1)
    print(text)
    if config.out is not None:
        write_whole(config.out, text + "\n")


def _pictures(detector: RetinaNet, config: Config) -> list[Any]:
    """Random tables in looks of their own, as the network's inputs."""
    renderer = SceneRenderer("nico", size=detector.frame.eye_size)
    found = []
    for number in range(config.pictures):
        rng = generator(config.seed, "compiled", number)
        layout = varied_layout(rng, [], invented=1.0)
        view = renderer.view(layout, appearance=Appearance.sample(rng), labels=False)
        found.append(detector.frame.prepare(view.image))
    return found


@torch.inference_mode()
def _measured(
    detector: RetinaNet,
    way: Callable[[Tensors, Tensor], Call],
    pictures: list[Tensor],
    rounds: int,
) -> dict[str, Any]:
    """Ratio to the eager network, milliseconds of both, seconds before the first answer."""
    clock = time.process_time if torch.get_num_threads() == 1 else time.perf_counter
    usual = Tensors(detector).eval()
    began = time.perf_counter()
    try:
        call = way(Tensors(copy.deepcopy(detector)).eval(), pictures[0])
        answer = call(pictures[0])
    except Exception as error:  # each tool has its own
        return {"fails": f"{type(error).__name__}: {str(error).splitlines()[0][:160]}"}
    first = time.perf_counter() - began
    ratios, spent, eagers, cells, pixels = [], [], [], 0.0, 0.0
    for number in range(rounds + 2):
        picture = pictures[number % len(pictures)]
        started = clock()
        wanted = usual(picture)
        between = clock()
        answer = call(picture)
        ended = clock()
        if number < 2:
            continue
        eagers.append(1000 * (between - started))
        spent.append(1000 * (ended - between))
        ratios.append(eagers[-1] / spent[-1])
        cells = max(cells, _apart(wanted[3].softmax(-1), answer[3].float().softmax(-1)))
        head = detector.pose_head
        pixels = max(
            pixels,
            _apart(
                *(head.project(pose.float(), head.landmarks) for pose in (wanted[2], answer[2]))
            ),
        )
    return {
        "ratio": round(median(ratios), 3),
        "milliseconds": round(median(spent), 1),
        "eager_milliseconds": round(median(eagers), 1),
        "first_answer_seconds": round(first, 1),
        "largest_difference": {"cells": float(f"{cells:.2g}"), "pixels": float(f"{pixels:.2g}")},
    }


def _apart(one: Tensor, other: Tensor) -> float:
    return float((one - other).abs().max())


if __name__ == "__main__":
    main(tyro.cli(Config, description=__doc__))
