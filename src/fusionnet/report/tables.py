"""A chapter's numbers beside the thesis's, and where they come from."""

from fusionnet.report.chapters import Chapter


def table(chapter: Chapter) -> list[list[str]]:
    """Cells of a chapter's table: variant, mean and deviation, interval, seeds, the thesis."""
    rows = []
    for summary in chapter.summaries:
        stated = chapter.published(summary.variant.name)
        thesis = "–"
        if stated is not None:
            spread = "" if stated.deviation is None else f" ± {stated.deviation:g}"
            thesis = f"{stated.mean:g}{spread} ({stated.where})"
        rows.append(
            [
                summary.variant.label or summary.variant.name,
                f"{summary.mean:.4g} ± {summary.deviation:.2g}",
                f"{summary.low:.4g} to {summary.high:.4g}",
                str(len(summary.values)),
                thesis,
            ]
        )
    return rows


def notes(chapter: Chapter) -> str:
    """Set-up, how ours differs, and where the numbers come from."""
    experiment = chapter.experiment
    assert chapter.scale is not None
    sources = {str(r.provenance.get("commit")) for r in chapter.records}
    machine = chapter.records[0].provenance
    parts = [
        f"The thesis: {experiment.setup}",
        f"Ours ({chapter.scale}): {experiment.differs.get(chapter.scale, 'the same')}",
        experiment.caution,
        f"{len(chapter.records)} runs, {chapter.minutes:.0f} minutes in all, commit "
        f"{', '.join(sorted(sources))}, {machine.get('processor')}, {machine.get('device')}.",
    ]
    return " ".join(part for part in parts if part)
