"""Every experiment of the thesis, and ours: one file each, found by the catalogue.

A module here offers `EXPERIMENT`, an `Experiment`: the thesis's set-up and published
numbers as data, the variants that are compared, and a function that runs one of them
with one seed. `reproduce` runs what is missing and keeps one whole JSON file a run.
"""

from fusionnet.catalogue import Catalogue
from fusionnet.experiments._experiment import (
    Claim,
    Experiment,
    Figure,
    Outcome,
    Published,
    Scale,
    Search,
    Trial,
    Variant,
)
from fusionnet.experiments._records import Record, of_one_setup, read_records
from fusionnet.experiments._reproduce import reproduce
from fusionnet.experiments._runner import Plan
from fusionnet.experiments._search import proposal_name
from fusionnet.experiments._sources import corpus_for, require
from fusionnet.experiments._verdict import Judgement, Summary, judge, less_is_better, summaries

catalogue = Catalogue("fusionnet.experiments", kind="experiment", attribute="EXPERIMENT")
load = catalogue.load
names = catalogue.names

__all__ = [
    "Claim",
    "Experiment",
    "Figure",
    "Judgement",
    "Outcome",
    "Plan",
    "Published",
    "Record",
    "Scale",
    "Search",
    "Summary",
    "Trial",
    "Variant",
    "corpus_for",
    "judge",
    "less_is_better",
    "load",
    "names",
    "of_one_setup",
    "proposal_name",
    "read_records",
    "reproduce",
    "require",
    "summaries",
]
