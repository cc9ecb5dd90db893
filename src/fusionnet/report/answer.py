"""The thesis's question, *do intermediate representations increase performance?*, answered."""

from collections.abc import Sequence

from fusionnet.report.chapters import Chapter

QUESTION = "Do intermediate representations increase performance in a multimodal neural network?"

EXPERIMENT = "ablation"
"""The experiment that answers it."""

ANSWER = (
    ("executed_success", "executed success, share of episodes"),
    ("joint_error_degrees", "mean joint error, degrees"),
)
"""The metrics of the first figure, with the labels of their axes."""


def answer_chapter(chapters: Sequence[Chapter]) -> Chapter | None:
    """The chapter of the ablation, if it has been run."""
    for chapter in chapters:
        if chapter.experiment.name == EXPERIMENT and chapter.records:
            return chapter
    return None


def answer_words(chapters: Sequence[Chapter]) -> str:
    """The answer as far as the records bear one."""
    chapter = answer_chapter(chapters)
    if chapter is None:
        return f"{QUESTION} The ablation has not been run here yet, so there is no answer yet."
    said = []
    for verdict, words in (
        ("agrees", "Borne out: "),
        ("differs", "The opposite is borne out: "),
        ("cannot tell", "Cannot be told: "),
        ("not run", "Not run: "),
    ):
        claims = [j.claim.says for j in chapter.judgements if j.verdict == verdict]
        if claims:
            said.append(words + " ".join(claims))
    seeds = "one seed" if chapter.seeds == 1 else f"up to {chapter.seeds} seeds"
    return f"{QUESTION} At the {chapter.scale} scale, over {seeds}. {' '.join(said)}"
