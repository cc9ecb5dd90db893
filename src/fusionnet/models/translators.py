"""The translators that there are: which class reads which kind of checkpoint, and those we ship."""

from importlib import resources
from pathlib import Path

from fusionnet.errors import CheckpointError
from fusionnet.models import transformer, translator
from fusionnet.models.checkpoint import checkpoint_kind
from fusionnet.models.sentence_reader import SentenceReader

KINDS: dict[str, type[translator.Translator] | type[transformer.Transformer]] = {
    translator.KIND: translator.Translator,
    transformer.KIND: transformer.Transformer,
}
"""A checkpoint says its kind; the class that reads it."""

SHIPPED = ("compact",)
"""Names of the translators in this package."""


def load_translator(name: Path | str | None = None) -> SentenceReader:
    """A translator of any kind.

    Args:
        name: One of `SHIPPED` (compact by default), or the folder of a checkpoint.

    Raises:
        CheckpointError: If it is missing, damaged, of another version or no translator.
    """
    folder = translator_folder("compact" if name is None else name)
    kind = checkpoint_kind(folder)
    if kind not in KINDS:
        raise CheckpointError(
            f"The checkpoint {folder} holds a {kind!r}, expected one of: {', '.join(KINDS)}."
        )
    return KINDS[kind].from_folder(folder)


def translator_folder(name: Path | str) -> Path:
    """Where a shipped translator, or one in a folder, has its checkpoint."""
    if str(name) in SHIPPED:
        return Path(str(resources.files("fusionnet"))) / "weights" / str(name) / "translator"
    return Path(name)
