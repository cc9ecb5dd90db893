"""A chapter's numbers beside the thesis's, and where they come from."""

from fusionnet.experiments import Published, Summary
from fusionnet.report.chapters import Chapter
from fusionnet.report.reading import metric_words

HEAD = ("variant", "metric", "ours", "95 % interval", "seeds", "thesis")
"""Titles of the columns."""

MOST_ROWS = 12
"""Rows of a metric that a search's variants fill; the best come first. Of the thesis's variants
that were not run here, no more either."""


def table(chapter: Chapter) -> list[list[str]]:
    """Cells of a chapter's table, a row a variant and metric.

    The deciding metric of every variant, then those metrics of which the thesis states
    numbers or of which something is claimed. Variants of the thesis that were not run here
    stand behind ours.
    """
    experiment = chapter.experiment
    others = [p.metric for p in experiment.published] + [c.metric for c in experiment.claims]
    rows = []
    for metric in dict.fromkeys([experiment.metric, *filter(None, others)]):
        stated = chapter.stated(metric)
        found = {s.variant.name: s for s in chapter.summaries_of(metric)}
        listed = {v.name for v in experiment.variants("thesis")}
        proposed = [name for name in found if name not in listed]
        names = [n for n in chapter.variants if n in found or n in stated]
        unrun = [n for n in names if n not in found]
        names = [n for n in names if n not in proposed[MOST_ROWS:] + unrun[MOST_ROWS:]]
        rows += [_row(chapter, n, metric, found.get(n), stated.get(n)) for n in names]
    return rows


def _row(
    chapter: Chapter, name: str, metric: str, ours: Summary | None, stated: Published | None
) -> list[str]:
    variant = chapter.variants[name]
    thesis = "–"
    if stated is not None:
        spread = "" if stated.deviation is None else f" ± {stated.deviation:g}"
        thesis = f"{stated.mean:g}{spread} ({stated.where})"
    cells = ["not run", "", ""]
    if ours is not None:
        deviation = f" ± {ours.deviation:.2g}" if len(ours.values) > 1 else ""
        interval = f"{ours.low:.4g} to {ours.high:.4g}" if len(ours.values) > 1 else "–"
        cells = [f"{ours.mean:.4g}{deviation}", interval, str(len(ours.values))]
    return [variant.label or variant.name, metric_words(metric), *cells, thesis]


def notes(chapter: Chapter) -> str:
    """Set-up, how ours differs, the test, and where the numbers come from."""
    experiment = chapter.experiment
    assert chapter.scale is not None
    sources = {str(r.provenance.get("commit")) for r in chapter.records}
    machine = chapter.records[0].provenance
    setup = chapter.records[0].setup or experiment.differs.get(chapter.scale)
    left_out = f"{chapter.left_out} runs of another set-up are left out."
    parts = [
        f"The thesis: {experiment.setup}",
        f"Ours ({chapter.scale}): {setup or 'the same.'}",
        experiment.caution,
        experiment.test if experiment.claims else "",
        f"{len(chapter.records)} runs, {chapter.minutes:.0f} minutes in all, commit "
        f"{', '.join(sorted(sources))}, {machine.get('processor')}, {machine.get('device')}; "
        f"`{chapter.records[0].command} --again --data DIR` makes them again.",
        left_out if chapter.left_out else "",
    ]
    return " ".join(part for part in parts if part)
