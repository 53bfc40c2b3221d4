"""All data sets that are read, by name."""

from __future__ import annotations

from perfcap.errors import InputError
from perfcap.io.datasets.emdb import EMDB
from perfcap.io.datasets.human36m import HUMAN36M
from perfcap.io.datasets.humaneva import HUMANEVA
from perfcap.io.datasets.monoperfcap import MONOPERFCAP
from perfcap.io.datasets.mpi_inf_3dhp import MPI_INF_3DHP
from perfcap.io.datasets.panoptic import PANOPTIC
from perfcap.io.datasets.pose2sim import POSE2SIM
from perfcap.io.datasets.rendered import RENDERED
from perfcap.io.datasets.sequence import Dataset
from perfcap.io.datasets.three_dpw import THREE_DPW

DATASETS = (
    *(MONOPERFCAP, HUMAN36M, MPI_INF_3DHP, HUMANEVA, THREE_DPW, EMDB, PANOPTIC),
    *(RENDERED, POSE2SIM),
)


def find_dataset(name: str) -> Dataset:
    """A data set by name.

    Raises:
        InputError: there is none of that name.
    """
    for dataset in DATASETS:
        if dataset.name == name:
            return dataset
    names = ", ".join(dataset.name for dataset in DATASETS)
    raise InputError(f"--dataset {name!s:.40}: is not read; expected one of {names}")
