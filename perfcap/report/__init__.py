"""A result as a page that plays in a browser, from disk, without a network."""

from perfcap.report.compare import make_comparison
from perfcap.report.make import Wanted, make_report, show
from perfcap.report.sources import Places

__all__ = ["Places", "Wanted", "make_comparison", "make_report", "show"]
