"""A result as a page that plays in a browser, from disk, without a network."""

from perfcap.report.compare import make_comparison
from perfcap.report.everybody import make_people_report
from perfcap.report.make import Wanted, make_report, show
from perfcap.report.sources import Places
from perfcap.report.viewers import add_to_viser, log_to_rerun

__all__ = [
    "Places",
    "Wanted",
    "add_to_viser",
    "log_to_rerun",
    "make_comparison",
    "make_people_report",
    "make_report",
    "show",
]
