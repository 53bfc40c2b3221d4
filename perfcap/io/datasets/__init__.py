"""Readers of recordings with truth, in the layouts they are published in."""

from perfcap.io.datasets.registry import DATASETS, find_dataset
from perfcap.io.datasets.sequence import Dataset, DatasetSequence, Mesh, Protocol, SurfaceTruth

__all__ = [
    "DATASETS",
    "Dataset",
    "DatasetSequence",
    "Mesh",
    "Protocol",
    "SurfaceTruth",
    "find_dataset",
]
