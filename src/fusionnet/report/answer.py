"""The thesis's question, *do intermediate representations increase performance?*, answered."""

from collections.abc import Sequence

from fusionnet.experiments import summaries
from fusionnet.report.chapters import Chapter

QUESTION = "Do intermediate representations increase performance in a multimodal neural network?"

EXPERIMENT = "ablation"
"""The experiment that answers it."""

CELLS_RIGHT = "cells_right"
"""The metric that the words give."""

ANSWER = (
    ("joint_error_degrees", "mean joint error, degrees"),
    (CELLS_RIGHT, "grasp and place cell both right, share of commands"),
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
    said = [_numbers(chapter)]
    for verdict, words in (
        ("agrees", "Borne out: "),
        ("differs", "The opposite is borne out: "),
        ("cannot tell", "Cannot be told: "),
        ("not run", "Not run: "),
    ):
        claims = [j.claim.says for j in chapter.judgements if j.verdict == verdict]
        if claims:
            said.append(words + " ".join(claims))
    count = len({record.seed for record in chapter.records})
    seeds = "one seed" if count == 1 else f"up to {count} seeds"
    said = [sentence for sentence in said if sentence]
    return f"{QUESTION} At the {chapter.scale} scale, over {seeds}. {' '.join(said)}"


def _numbers(chapter: Chapter) -> str:
    """How often both cells are right, with intervals, of the variants that point at cells."""
    found = summaries(chapter.records, CELLS_RIGHT)
    if not found:
        return ""
    found.sort(key=lambda s: list(chapter.variants).index(s.variant.name))
    numbers = (
        f"{s.variant.label or s.variant.name} {s.mean:.1%} [{s.low:.1%}, {s.high:.1%}]"
        for s in found
    )
    return f"Grasp and place cell both right: {'; '.join(numbers)}."
