"""The thesis's question, *do intermediate representations increase performance?*, answered."""

from collections.abc import Sequence

from fusionnet.experiments import summaries
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
    """Executed success, with intervals, of the variants that landed any block."""
    metric = ANSWER[0][0]
    found = [s for s in summaries(chapter.records, metric) if max(s.values) > 0]
    if not found:
        return ""
    found.sort(key=lambda s: list(chapter.variants).index(s.variant.name))
    numbers = (
        f"{s.variant.label or s.variant.name} {s.mean:.1%} [{s.low:.1%}, {s.high:.1%}]"
        for s in found
    )
    return f"Executed success: {'; '.join(numbers)}; 0 of any other variant."
