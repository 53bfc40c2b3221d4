"""Triangles know their limb."""

import numpy as np
from synthetic import actor, rest_positions

from perfcap.pipeline.refine import TRUNK, limb_of_triangles


def test_limbs_lie_where_they_are() -> None:
    """Left is +x, arms are above the hips, and mirrored limbs have as many triangles."""
    person, at = actor(), rest_positions()
    limbs, faces = limb_of_triangles(person), person.template.faces
    middle = person.template.vertices[faces].mean(1)
    assert limbs.shape == (len(faces),) and set(limbs) == {TRUNK, 1, 2, 3, 4}
    count = np.bincount(limbs)
    assert count[1] == count[2] > 30 and count[3] == count[4] > 30
    assert (middle[limbs == 1, 0] > 0.1).all() and (middle[limbs == 2, 0] < -0.1).all()
    assert (middle[limbs == 3, 0] > 0).all() and (middle[limbs == 4, 0] < 0).all()
    waist = float(at["spine"][1])
    assert (middle[(limbs == 3) | (limbs == 4), 1] < waist).all()
    assert (np.abs(middle[limbs == TRUNK, 0]) < 0.2).all()
