"""The report for the documentation: Markdown, with one SVG file a figure."""

from collections.abc import Sequence

from fusionnet.report.answer import ANSWER, answer_chapter, answer_words
from fusionnet.report.chapters import Chapter
from fusionnet.report.figures import draw, draw_answer
from fusionnet.report.reading import caption, multiplicity, reading, verdict_sentence
from fusionnet.report.tables import HEAD, notes, table


def markdown_page(chapters: Sequence[Chapter], images: str) -> tuple[str, dict[str, str]]:
    """The page's text, and the SVG of each of its figures by file name.

    Args:
        chapters: What has been run.
        images: Folder of the figures as seen from the page.
    """
    lines = ["# Results", "", f"> {answer_words(chapters)}", ""]
    figures: dict[str, str] = {}
    lead = answer_chapter(chapters)
    if lead is not None:
        figures["answer.svg"] = draw_answer(lead, ANSWER)
        lines += [f"![Error and cells right with each representation]({images}/answer.svg)", ""]
    if chance := multiplicity(chapters):
        lines += [chance, ""]
    for chapter in chapters:
        lines += _section(chapter, images, figures)
    return "\n".join(lines).rstrip() + "\n", figures


def _section(chapter: Chapter, images: str, figures: dict[str, str]) -> list[str]:
    experiment = chapter.experiment
    place = "ours" if experiment.section == "ours" else f"thesis {experiment.section}"
    lines = [f"## {experiment.title} ({place})", "", experiment.question, "", reading(chapter), ""]
    if not chapter.summaries:
        return lines
    for number, figure in enumerate(experiment.figures):
        name = f"{experiment.name}-{number + 1}.svg"
        figures[name] = draw(chapter, figure)
        lines += [f"![{caption(experiment, figure)}]({images}/{name})", ""]
    lines += [
        f"| {' | '.join(HEAD)} |",
        "| --- " * len(HEAD) + "|",
    ]
    for cells in table(chapter):
        lines.append(f"| {' | '.join(cells)} |")
    lines += ["", *(f"- {j.claim.says} **{verdict_sentence(j)}**" for j in chapter.judgements)]
    lines += ["", f"*{notes(chapter)}*", ""]
    return lines
