"""The body that tests of fits share."""

import pytest
from bodies import few_shapes

from perfcap.actor.body_model import BodyModel


@pytest.fixture(scope="session")
def model() -> BodyModel:
    """The first components of the shipped body."""
    return few_shapes()
