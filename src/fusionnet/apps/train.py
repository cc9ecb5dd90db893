"""`fusionnet train ...`: the trainers of the library, with a bar for each of their stages.

Of several processes, one a device, a trainer gives its metrics to the first alone: the others
print nothing.
"""

from typing import Any

from fusionnet.apps.progress import bars
from fusionnet.training.detector import DetectorConfig
from fusionnet.training.detector import train as train_detector
from fusionnet.training.end_to_end import EndToEndConfig
from fusionnet.training.end_to_end import train as train_end_to_end
from fusionnet.training.fusion import FusionConfig
from fusionnet.training.fusion import train as train_fusion
from fusionnet.training.policy import PolicyConfig
from fusionnet.training.policy import train as train_policy
from fusionnet.training.thesis_detector import ThesisDetectorConfig
from fusionnet.training.thesis_detector import train as train_thesis_detector
from fusionnet.training.thesis_fusion import train as train_thesis_fusion
from fusionnet.training.thesis_fusion_config import SmallThesisFusionConfig, ThesisFusionConfig
from fusionnet.training.transformer import ThesisTranslatorConfig
from fusionnet.training.transformer import train as train_transformer
from fusionnet.training.translator import TranslatorConfig
from fusionnet.training.translator import train as train_translator


def detector(config: DetectorConfig | ThesisDetectorConfig) -> dict[str, Any] | None:
    """Train the detector on data sets that `fusionnet dataset build` made.

    --preset compact (what we ship): boxes, the camera's pose, the layout.
    --preset thesis: the thesis's RetinaNet (boxes, nodes for FusionNet), on a data set.
    Put `--preset NAME --help` for the options of one. Prints its metrics on the validation
    groups as JSON.
    """
    with bars() as bar:
        if isinstance(config, ThesisDetectorConfig):
            return train_thesis_detector(config, progress=bar("training")) or None
        return train_detector(config, progress=bar("training")) or None


DETECTOR_PRESETS = {"compact": DetectorConfig, "thesis": ThesisDetectorConfig}


def translator(config: TranslatorConfig | ThesisTranslatorConfig) -> dict[str, Any] | None:
    """Train a translator: a sentence to its tree.

    --preset compact (what we ship): short runs of symbols, and the words of each.
    --preset thesis: the thesis's Transformer, to the text of the tree.
    Put `--preset NAME --help` for the options of one. Prints its metrics on the commands
    kept apart as JSON.
    """
    with bars() as bar:
        if isinstance(config, ThesisTranslatorConfig):
            return train_transformer(config, progress=bar("training")) or None
        return train_translator(config, progress=bar("training")) or None


TRANSLATOR_PRESETS = {"compact": TranslatorConfig, "thesis": ThesisTranslatorConfig}


def fusion(
    config: FusionConfig | EndToEndConfig | ThesisFusionConfig | SmallThesisFusionConfig,
) -> dict[str, Any] | None:
    """Train FusionNet: picture and sentence to the fourteen values.

    --preset compact (what we ship): the tree carried out on the layout that was seen.
    --preset end-to-end: all three parts of a policy as one network, on a data set.
    --preset thesis: the thesis's FusionNet at its own size, on a data set.
    --preset thesis-small: the same architecture for a CPU: small pictures and networks.
    Put `--preset NAME --help` for the options of one. A run that was stopped goes on where its
    `--work` folder says. Prints its metrics as JSON.
    """
    with bars() as bar:
        if isinstance(config, ThesisFusionConfig):
            return train_thesis_fusion(config, progress=bar("training")) or None
        if isinstance(config, EndToEndConfig):
            return train_end_to_end(config, progress=bar("training")) or None
        return train_fusion(config, progress=bar("training"), rendering=bar("rendering")) or None


FUSION_PRESETS = {
    "compact": FusionConfig,
    "end-to-end": EndToEndConfig,
    "thesis": ThesisFusionConfig,
    "thesis-small": SmallThesisFusionConfig,
}


def policy(config: PolicyConfig) -> dict[str, Any]:
    """Train a whole policy: pictures, both eyes' detectors, translator and FusionNet.

    About five hours, mostly of one core. A run that was stopped goes on where its `--work`
    folder says. Prints the metrics of every part as JSON; `fusionnet run --checkpoint OUT` moves
    by it.
    """
    with bars() as bar:
        return train_policy(config, bar)
