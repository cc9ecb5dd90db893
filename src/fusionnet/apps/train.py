"""`fusionnet train ...`: the trainers of the library, with a bar for each of their stages."""

from typing import Any

from fusionnet.apps.progress import bars
from fusionnet.training.detector import DetectorConfig
from fusionnet.training.detector import train as train_detector
from fusionnet.training.fusion import FusionConfig
from fusionnet.training.fusion import train as train_fusion
from fusionnet.training.translator import TranslatorConfig
from fusionnet.training.translator import train as train_translator


def detector(config: DetectorConfig) -> dict[str, Any]:
    """Render pictures and train the detector: boxes, the camera's pose, the layout.

    Prints its metrics on the validation groups as JSON.
    """
    with bars() as bar:
        return train_detector(config, progress=bar("training"), rendering=bar("rendering"))


def translator(config: TranslatorConfig) -> dict[str, Any]:
    """Train the translator: a sentence to its tree.

    Prints its metrics on the commands kept apart as JSON.
    """
    with bars() as bar:
        return train_translator(config, progress=bar("training"))


def fusion(config: FusionConfig) -> dict[str, Any]:
    """Train FusionNet: picture and sentence to the fourteen values.

    Prints its metrics on the validation groups as JSON.
    """
    with bars() as bar:
        return train_fusion(config, progress=bar("training"))
