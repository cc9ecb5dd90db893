"""What the numbers say, in two sentences, and no more than they bear."""

from fusionnet.experiments import Judgement
from fusionnet.report.chapters import Chapter

ENOUGH_SEEDS = 3


def reading(chapter: Chapter) -> str:
    """Two sentences: what was found, and how it stands to the thesis."""
    experiment = chapter.experiment
    if not chapter.summaries:
        return (
            "This has not been run yet. "
            f"`fusionnet reproduce {experiment.name} --scale small` runs it."
        )
    best = (min if experiment.lower_is_better else max)(chapter.summaries, key=lambda s: s.mean)
    found = (
        f"At the {chapter.scale} scale, {best.variant.label or best.variant.name} has the best "
        f"{metric_words(experiment.metric)}: {best.mean:.4g} [{best.low:.4g}, {best.high:.4g}] "
        f"over {_seeds(len(best.values))}."
    )
    return f"{found} {_verdicts(chapter)}"


def _verdicts(chapter: Chapter) -> str:
    run = [j for j in chapter.judgements if j.verdict != "not run"]
    if not run:
        return "No claim of the thesis is tested by it."
    said = []
    for verdict in ("agrees", "differs", "cannot tell"):
        count = sum(j.verdict == verdict for j in run)
        if count:
            said.append(f"{verdict} {_with_what(verdict)} {count} of {len(run)}")
    few = "" if chapter.seeds >= ENOUGH_SEEDS else " (too few seeds to tell anything)"
    return f"Of the claims that it tests, it {', '.join(said)}{few}."


def _with_what(verdict: str) -> str:
    return {"agrees": "with", "differs": "from", "cannot tell": "of"}[verdict]


def verdict_sentence(judgement: Judgement) -> str:
    """A claim's verdict with the difference that it rests on."""
    difference = judgement.difference
    if difference is None:
        return "not run"
    return (
        f"{judgement.verdict}: difference {difference.mean:+.3g} "
        f"[{difference.low:+.3g}, {difference.high:+.3g}], "
        f"{_seeds(difference.seeds)}, p {difference.p_value:.2g}"
    )


def metric_words(metric: str) -> str:
    """A metric's name as words."""
    return metric.replace("_", " ")


def _seeds(count: int) -> str:
    return "one seed" if count == 1 else f"{count} seeds"
