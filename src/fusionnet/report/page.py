"""The report as one self-contained HTML page: no scripts, no other files, no network."""

from collections.abc import Sequence
from html import escape
from importlib import resources

from fusionnet.report.answer import ANSWER, QUESTION, answer_chapter, answer_words
from fusionnet.report.chapters import Chapter
from fusionnet.report.figures import draw, draw_answer
from fusionnet.report.reading import caption, multiplicity, reading, verdict_sentence
from fusionnet.report.tables import HEAD, notes, table

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>FusionNet: results</title><style>{style}</style></head>
<body><main>
<header><h1>{question}</h1><p class="answer">{answer}</p>{figure}<p>{chance}</p></header>
<nav><h2>Experiments</h2><ol>{contents}</ol></nav>
{sections}
</main></body></html>
"""

_MEANS = (
    "Ours: mean and 95 % bootstrap interval over seeds. "
    "The thesis: mean and standard deviation, as far as it states them."
)
WHISKERS = {
    "bars": f"{_MEANS} Dots: single runs.",
    "ranked": f"{_MEANS} The axes do not begin at 0.",
    "lines": _MEANS,
    "scatter": _MEANS,
    "curves": "Thin: single runs; thick: the mean of each variant.",
}
"""What the marks of each kind of figure mean."""


def html_page(chapters: Sequence[Chapter]) -> str:
    """The whole report."""
    lead = answer_chapter(chapters)
    style = resources.files("fusionnet.report").joinpath("report.css").read_text("utf-8")
    return PAGE.format(
        style=style,
        question=escape(QUESTION),
        answer=escape(answer_words(chapters).removeprefix(QUESTION).strip()),
        figure="" if lead is None else f"<figure>{draw_answer(lead, ANSWER)}</figure>",
        chance=escape(multiplicity(chapters)),
        contents="".join(
            f'<li><a href="#{c.experiment.name}">{escape(c.experiment.title)}</a> '
            f"<small>{escape(_state(c))}</small></li>"
            for c in chapters
        ),
        sections="".join(map(_section, chapters)),
    )


def _state(chapter: Chapter) -> str:
    if chapter.scale is None:
        return "not run"
    return f"{chapter.scale}, {len(chapter.records)} runs"


def _section(chapter: Chapter) -> str:
    experiment = chapter.experiment
    place = "ours" if experiment.section == "ours" else f"thesis {experiment.section}"
    head = (
        f'<section id="{experiment.name}"><h2>{escape(experiment.title)} '
        f"<small>{escape(place)}</small></h2>"
        f"<p><em>{escape(experiment.question)}</em></p><p>{escape(reading(chapter))}</p>"
    )
    if not chapter.summaries:
        return f"{head}</section>"
    figures = "".join(
        f"<figure>{draw(chapter, figure)}<figcaption>"
        f"{escape(caption(experiment, figure))}. {escape(WHISKERS.get(figure.kind, ''))}"
        "</figcaption></figure>"
        for figure in experiment.figures
    )
    rows = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>"
        for cells in table(chapter)
    )
    claims = "".join(
        f'<li class="{j.verdict.replace(" ", "-")}">{escape(j.claim.says)} '
        f"<b>{escape(verdict_sentence(j))}</b></li>"
        for j in chapter.judgements
    )
    return (
        f"{head}{figures}<table><thead><tr>"
        + "".join(f"<th>{escape(title)}</th>" for title in HEAD)
        + f"</tr></thead><tbody>{rows}</tbody></table><ul>{claims}</ul>"
        f'<p class="notes">{escape(notes(chapter))}</p></section>'
    )
