"""Bodies found in meshes: energies against differences, truth recovered, bad meshes refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from checks import check_energy

from perfcap.actor.bare_mesh import BareMesh
from perfcap.actor.body_model import BodyModel
from perfcap.actor.motion import BODY, Motion
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.energy import SharedPrior
from perfcap.errors import InputError
from perfcap.io.body_model import load_body_model
from perfcap.rigging.auto_rig import auto_rig, rig_with_joints
from perfcap.rigging.fit_surface import BodyFitter, FitSettings
from perfcap.rigging.surface_match import Matches, SurfaceMatch

QUICK = FitSettings(screened=1, first=2, rounds=7, samples=(250, 350), arms=(40.0,))


@pytest.fixture(scope="module")
def model() -> BodyModel:
    return load_body_model()


@pytest.fixture(scope="module")
def fitter(model: BodyModel) -> BodyFitter:
    return BodyFitter(model, QUICK)


def person(fitter: BodyFitter) -> Motion:
    """Somebody with raised arms."""
    start = fitter.starts()[0]
    random = torch.Generator().manual_seed(3)
    shape = torch.zeros(fitter.model.components, dtype=torch.float64)
    shape[:8] = 0.8 * torch.randn(8, generator=random, dtype=torch.float64)
    turned = start.angles + 0.08 * torch.randn(27, generator=random, dtype=torch.float64)
    lower, upper = fitter.actor.skeleton.lower, fitter.actor.skeleton.upper
    return Motion(start.translation, start.rotation, turned.clamp(lower, upper), {BODY: shape})


def test_energies_pass_the_checks(model: BodyModel) -> None:
    small = BodyModel.from_arrays(
        {
            "vertices": model.surface.mean.numpy(),
            "faces": model.rig.faces,
            "shape_basis": model.surface.basis[:3].numpy(),
            "bone_names": np.array(model.rig.bone_names),
            "bone_parents": model.rig.bone_parents,
            "bone_positions": model.bones.mean.numpy(),
            "bone_basis": model.bones.basis[:3].numpy(),
            "weights": model.rig.weights,
            "weight_bones": model.rig.weight_bones,
        }
    )
    actor = small.actor(torch.zeros(3))
    points = ShapedPoints.of_surface(small, actor, np.arange(0, len(small.surface.mean), 701))
    random = torch.Generator().manual_seed(0)
    rest = actor.skeleton.rest_motion()
    shape = torch.tensor([0.3, -0.2, 0.5], dtype=torch.float64)
    angles = rest.angles + 0.1 * torch.randn(27, generator=random, dtype=torch.float64)
    state = Motion(rest.translation, rest.rotation + 0.1, angles, {BODY: shape})
    count = len(points.mean)
    place = points(state)[0] + 0.1 * torch.randn(count, 3, generator=random, dtype=torch.float64)
    normal = torch.nn.functional.normalize(place - place.mean(0), dim=-1)
    matches = Matches(place, normal, torch.rand(count, generator=random, dtype=torch.float64))
    check_energy(SurfaceMatch(points, matches, weight=2.0), state)
    check_energy(SharedPrior(3, weight=0.5), state)


def test_a_posed_body_is_recovered(fitter: BodyFitter) -> None:
    truth = person(fitter)
    surface = fitter.surface(truth)[0].numpy()
    found = fitter.fit(surface, fitter.model.rig.faces)
    marks = fitter.marks(truth)[0].numpy()
    errors = np.linalg.norm(np.stack(list(found.joints.values()))[:16] - marks[:16], axis=1)
    assert errors.mean() < 0.02
    assert found.far == 0.0


def test_starts_have_the_stature_of_the_mesh(fitter: BodyFitter) -> None:
    (start, *_) = fitter.starts()
    plain = float(np.ptp(fitter.surface(start)[0].numpy()[:, 1]))
    for height in (plain - 0.12, plain + 0.12):
        sized = fitter._with_stature(start, height)
        assert np.ptp(fitter.surface(sized)[0].numpy()[:, 1]) == pytest.approx(height, abs=0.02)


@pytest.mark.long
def test_what_is_no_person_is_refused(model: BodyModel) -> None:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.9)
    mesh = BareMesh(np.asarray(ball.vertices), np.asarray(ball.faces), name="ball")
    with pytest.raises(InputError, match="one person"):
        auto_rig(mesh, model, settings=replace(QUICK, first=1, rounds=2))
    with pytest.raises(InputError, match="no faces"):
        auto_rig(BareMesh(np.zeros((4, 3)), np.empty((0, 3), np.int64)), model)
    body, faces = model.surface.mean.numpy(), model.rig.faces
    pair = (
        np.concatenate((body, body + np.array([1.5, 0, 0]))),
        np.concatenate((faces, faces + len(body))),
    )
    with pytest.raises(InputError, match="side by side"):
        auto_rig(BareMesh(*pair), model)


@pytest.mark.long
def test_a_scan_that_is_inside_out_is_turned_round(fitter: BodyFitter) -> None:
    surface, faces = fitter.surface(person(fitter))[0].numpy(), fitter.model.rig.faces
    right, inside_out = (
        auto_rig(BareMesh(surface, each), fitter.model, settings=QUICK)
        for each in (faces, faces[:, ::-1].copy())
    )
    assert np.array_equal(right[0].faces, inside_out[0].faces)
    assert np.allclose(right[0].bone_rest, inside_out[0].bone_rest)
    assert not right[1].warnings
    assert ["faced inwards" in line for line in inside_out[1].warnings] == [True]


@pytest.mark.long
def test_a_scan_that_holds_the_body_twice_says_so(fitter: BodyFitter) -> None:
    surface, faces = fitter.surface(person(fitter))[0].numpy(), fitter.model.rig.faces
    parts = (("scan", len(surface)), ("copy", len(surface)))
    mesh = BareMesh(np.tile(surface, (2, 1)), np.vstack((faces, faces + len(surface))), parts=parts)
    warnings = auto_rig(mesh, fitter.model, settings=QUICK)[1].warnings
    assert ["one inside the other" in line for line in warnings].count(True) == 1


def test_given_joints_are_kept(fitter: BodyFitter) -> None:
    truth = person(fitter)
    surface = fitter.surface(truth)[0].numpy()
    names = (*fitter.actor.skeleton.rig.landmarks, *fitter.actor.skeleton.rig.joints)
    joints = dict(zip(names, fitter.marks(truth)[0].numpy(), strict=True))
    template, report = rig_with_joints(BareMesh(surface, fitter.model.rig.faces), joints)
    assert np.allclose(template.bone_rest[template.bone("l_knee"), :3, 3], joints["l_knee"])
    assert np.allclose(template.weights.sum(1), 1)
    assert report.seen > 0.8
    del joints["l_toe"]
    with pytest.raises(InputError, match="lack l_toe"):
        rig_with_joints(BareMesh(surface, fitter.model.rig.faces), joints)


@pytest.mark.long
def test_given_joints_of_something_else_are_named(
    fitter: BodyFitter, caplog: pytest.LogCaptureFixture
) -> None:
    """A mesh was rigged with any joints: sides exchanged, in centimetres, beside it."""
    truth = person(fitter)
    mesh = BareMesh(fitter.surface(truth)[0].numpy(), fitter.model.rig.faces, name="scan")
    names = (*fitter.actor.skeleton.rig.landmarks, *fitter.actor.skeleton.rig.joints)
    joints = dict(zip(names, fitter.marks(truth)[0].numpy(), strict=True))
    rig_with_joints(mesh, joints)
    assert not [line for line in caplog.messages if "joints:" in line or "scale:" in line]
    other = {"l": "r", "r": "l"}
    exchanged = {
        f"{other[name[0]]}{name[1:]}" if name[1] == "_" else name: place
        for name, place in joints.items()
    }
    with pytest.raises(InputError, match=r"^mesh 'scan': left and right: joints called left are"):
        rig_with_joints(mesh, exchanged)
    with pytest.raises(InputError, match=r"^mesh 'scan': landmarks: head_top lies \d+ cm from"):
        rig_with_joints(mesh, {name: 100 * place for name, place in joints.items()})
    rig_with_joints(mesh, {name: place + np.array([0.12, 0, 0]) for name, place in joints.items()})
    assert any("lie outside the mesh" in line for line in caplog.messages)


@pytest.mark.slow
def test_a_mesh_in_centimetres_with_z_up_becomes_an_actor(fitter: BodyFitter) -> None:
    truth = person(fitter)
    surface = fitter.surface(truth)[0].numpy()
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    mesh = BareMesh(100 * surface @ turn.T, fitter.model.rig.faces, name="scan")
    template, report = auto_rig(mesh, fitter.model)
    assert report.upright is not None and report.upright.unit == "centimetres"
    marks = dict(zip(fitter.actor.skeleton.rig.landmarks, fitter.marks(truth)[0], strict=False))
    shift = surface[:, 1].min()
    for side in "lr":
        knee = template.bone_rest[template.bone(f"{side}_knee"), :3, 3]
        assert knee[1] == pytest.approx(float(marks[f"{side}_knee"][1]) - shift, abs=0.03)
    assert template.bone_rest[template.bone("l_knee"), 0, 3] > 0
