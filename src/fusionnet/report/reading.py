"""What the numbers say, in two sentences, and no more than they bear."""

from collections.abc import Sequence

from fusionnet.evaluation.intervals import ENOUGH_SEEDS
from fusionnet.experiments import Experiment, Figure, Judgement
from fusionnet.report.chapters import Chapter


def reading(chapter: Chapter) -> str:
    """Two sentences: what was found, and how it stands to the thesis.

    The best is that of the variants which were run with the most seeds: of many that were tried
    once, the best is so by luck, too.
    """
    experiment = chapter.experiment
    if not chapter.summaries:
        return (
            "This has not been run yet. "
            f"`fusionnet reproduce {experiment.name} --scale small` runs it."
        )
    repeated = [s for s in chapter.summaries if len(s.values) == chapter.seeds]
    best = (min if experiment.lower_is_better else max)(repeated, key=lambda s: s.mean)
    found = (
        f"At the {chapter.scale} scale, {best.variant.label or best.variant.name} has the best "
        f"{metric_words(experiment.metric)}: {best.mean:.4g} [{best.low:.4g}, {best.high:.4g}] "
        f"over {_seeds(len(best.values))}."
    )
    return f"{found} {_verdicts(chapter)}"


def _verdicts(chapter: Chapter) -> str:
    """How many claims of the thesis, and expectations of ours, are borne out, and why not."""
    run = [j for j in chapter.judgements if j.verdict != "not run"]
    if not run:
        return "No claim of the thesis is tested by it."
    said = []
    for source, whose in (("thesis", "the thesis's claims"), ("ours", "our own expectations")):
        judged = [j for j in run if j.claim.source == source]
        if judged:
            said.append(f"of {whose} it {_counts(judged)}")
    few = ""
    if chapter.seeds < ENOUGH_SEEDS:
        few = f" ({_seeds(chapter.seeds)}: too few to tell anything)"
    elif any(j.verdict == "cannot tell" for j in run):
        seeds = _seeds(chapter.seeds)
        few = f" (it cannot tell where the t interval of the difference holds zero over {seeds})"
    text = ", and ".join(said)
    return f"{text[0].upper()}{text[1:]}{few}."


def _counts(judged: list[Judgement]) -> str:
    said = []
    for verdict, words in (
        ("agrees", "agrees with"),
        ("differs", "differs from"),
        ("cannot tell", "cannot tell"),
    ):
        count = sum(j.verdict == verdict for j in judged)
        if count:
            said.append(f"{words} {count} of {len(judged)}")
    return ", ".join(said)


def verdict_sentence(judgement: Judgement) -> str:
    """A claim's verdict with the difference that it rests on."""
    difference = judgement.difference
    if difference is None:
        return "not run"
    interval = ""
    if difference.seeds > 1:
        interval = f", 95 % t interval [{difference.low:+.3g}, {difference.high:+.3g}]"
    return (
        f"{judgement.verdict}: difference {difference.mean:+.3g}{interval}, "
        f"{_seeds(difference.seeds)}"
    )


def multiplicity(chapters: Sequence[Chapter]) -> str:
    """How many verdicts chance alone would give, of all claims that could be told."""
    found = [j.difference for chapter in chapters for j in chapter.judgements]
    judged = sum(d is not None and d.seeds >= ENOUGH_SEEDS for d in found)
    clear = sum(d is not None and d.clear for d in found)
    if not judged:
        return ""
    return (
        f"Of {judged} claims, each judged by itself at 95 %, {clear} are borne out or "
        "contradicted. Nothing corrects for their number: were there no differences at all, about "
        f"{0.05 * judged:.0f} would be so by chance alone; a few of these may be."
    )


def caption(experiment: Experiment, figure: Figure) -> str:
    """What a figure shows."""
    like = f", in the form of the thesis's {figure.like}" if figure.like else ""
    return f"{figure.title or experiment.title}{like}"


def metric_words(metric: str) -> str:
    """A metric's name as words."""
    return metric.replace("_", " ")


def _seeds(count: int) -> str:
    return "one seed" if count == 1 else f"{count} seeds"
