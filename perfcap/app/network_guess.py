"""What the shapes of an unknown joint network tell about how to use it."""

from __future__ import annotations

from dataclasses import dataclass

from perfcap.detect.joint_set import (
    BLAZEPOSE33,
    BODY_25,
    COCO17,
    COCO_WHOLEBODY,
    HALPE26,
    HALPE136,
    LANDMARKS16,
    JointSet,
)
from perfcap.detect.session import Session
from perfcap.errors import InputError

_SETS = {
    len(s): s
    for s in (LANDMARKS16, COCO17, BODY_25, HALPE26, BLAZEPOSE33, COCO_WHOLEBODY, HALPE136)
}
_IMAGENET = "mean = [123.675, 116.28, 103.53]\nstd = [58.395, 57.12, 57.375]\n"
_MOVENET_COLUMNS = 3
_BLAZEPOSE_ROWS, _BLAZEPOSE_COLUMNS = 39, 5
_PEOPLE_ABOUT = 5  # numbers of a person beside joints
_PEOPLE_SIZE = 384  # pixels, of networks for images of any size


@dataclass(frozen=True)
class Guess:
    """A manifest without its files.

    Attributes:
        family: what the network looks like.
        text: the tables ``input``, ``output`` and ``joints``.
        check: what shapes do not tell, and a user should.
        closer: a network to name after it, where it does not look at people up close.
    """

    family: str
    text: str
    check: tuple[str, ...]
    closer: str = ""


def guess_manifest(session: Session, joint_set: JointSet | None) -> Guess:
    """Read a family of networks from names and shapes of inputs and outputs.

    Args:
        session: the open network.
        joint_set: of its joints; from their number if None.

    Raises:
        InputError: the shapes are of no family that is known.
    """
    name = session.inputs[0]
    shape = session.shapes[name]
    people = _people_output(session, joint_set or COCO17)
    if people is not None:
        layout, size = _image(session, shape, _PEOPLE_SIZE)
        return _people(session, people, layout, size, joint_set or COCO17)
    layout, size = _image(session, shape)
    outputs = {output: session.shapes[output] for output in session.outputs}
    simcc = [o for o, s in outputs.items() if len(s) == 3 and _wide(s, size)]
    if len(simcc) == 2:
        return _simcc(session, simcc, layout, size, joint_set)
    for output, found in outputs.items():
        numbers = 1
        for axis in found[1:]:
            numbers *= axis or 0
        if numbers == _BLAZEPOSE_ROWS * _BLAZEPOSE_COLUMNS:
            _require_set(session, joint_set, BLAZEPOSE33, "BlazePose")
            return _blazepose(session, output, layout, size)
        if numbers == len(COCO17) * _MOVENET_COLUMNS and found[-1] == _MOVENET_COLUMNS:
            _require_set(session, joint_set, COCO17, "MoveNet")
            return _movenet(session, output, layout, size)
    for output, found in outputs.items():
        if len(found) == 4 and all(found[1:]):
            if joint_set is not None:
                _require_count(session, joint_set, [found[1] or 0, found[3] or 0])
            return _heatmaps(output, found, layout, size, joint_set)
    shapes = "; ".join(f"{o} {list(s)}" for o, s in outputs.items())
    raise InputError(
        f"{session.path}: outputs {shapes} are of no family that is known (SimCC, heat maps, "
        "MoveNet of one or several people, BlazePose); write the manifest by hand, "
        "docs/detectors.md has examples"
    )


def _image(
    session: Session, shape: tuple[int | None, ...], any_size: int | None = None
) -> tuple[str, tuple[int, int]]:
    """Layout and size of the input image; sides that are open get a size, if there is one."""
    if len(shape) == 4:
        down, across, channels = (side or any_size for side in shape[1:])
        if channels == 3 and down and across:
            return "nhwc", (down, across)
        if down == 3 and across and channels:
            return "nchw", (across, channels)
    raise InputError(
        f"{session.path}: its input has shape {list(shape)}; expected one image of a fixed size, "
        "(N, 3, height, width) or (N, height, width, 3)"
    )


def _wide(shape: tuple[int | None, ...], size: tuple[int, int]) -> bool:
    """Whether an output (N, J, bins) has bins of pixels."""
    return shape[2] is not None and any(shape[2] % side == 0 for side in size)


def _simcc(
    session: Session,
    outputs: list[str],
    layout: str,
    size: tuple[int, int],
    joint_set: JointSet | None,
) -> Guess:
    """RTMPose and its relatives: the output of x has the width's bins."""
    bins = {output: session.shapes[output][2] or 0 for output in outputs}
    if size[0] != size[1]:
        outputs = sorted(outputs, key=lambda o: bins[o] * (1 if size[1] < size[0] else -1))
    split = bins[outputs[0]] / size[1]
    count = session.shapes[outputs[0]][1]
    if joint_set is not None and count is not None:
        _require_count(session, joint_set, [count])
    joints = joint_set or _by_count(session, count)
    listed = ", ".join(f'"{o}"' for o in outputs)
    text = (
        _input(layout, size, _IMAGENET)
        + f'\n[output]\nkind = "simcc"\nnames = [{listed}]\nsplit = {split:g}\n'
        + _joints(joints)
    )
    return Guess(
        f"SimCC, such as RTMPose, {joints.name}", text, ("color, mean and std: of ImageNet here",)
    )


def _heatmaps(
    output: str,
    shape: tuple[int | None, ...],
    layout: str,
    size: tuple[int, int],
    joint_set: JointSet | None,
) -> Guess:
    """ViTPose, HRNet and their relatives."""
    known = {len(joint_set): joint_set} if joint_set else _SETS
    places = [axis for axis in (1, 3) if shape[axis] in known]
    count = shape[places[0]] if places else shape[1]
    joints = known.get(count or 0)
    if joints is None:
        raise InputError(
            f"output {output!r} has {count} maps, which is no set that is known by its number; say "
            "--joints, or write joints.names by hand"
        )
    maps = "" if places[0] == 1 else 'layout = "nhwc"\n'
    text = (
        _input(layout, size, _IMAGENET)
        + f'\n[output]\nkind = "heatmaps"\nnames = ["{output}"]\ndecode = "dark"\n'
        + f'alignment = "corners"\n{maps}'
        + _joints(joints)
    )
    check = ("color, mean and std: of ImageNet here", "alignment: corners, as mmpose's UDP codecs")
    return Guess(f"heat maps, such as ViTPose or HRNet, {joints.name}", text, check)


def _movenet(session: Session, output: str, layout: str, size: tuple[int, int]) -> Guess:
    text = (
        _input(layout, size, f'dtype = "{_whole_or_not(session)}"\nturns = "quarters"\n')
        + f'\n[output]\nkind = "coordinates"\nnames = ["{output}"]\n'
        + 'columns = ["y", "x", "confidence"]\nunits = "unit"\n'
        + _joints(COCO17)
    )
    check = ("values: 0 to 255 in rgb here, without mean and std",)
    return Guess("MoveNet SinglePose, COCO-17", text, check)


def _people_output(session: Session, joint_set: JointSet) -> str | None:
    """The output of several people: one row each of joints, a box and a score."""
    wide = len(joint_set) * _MOVENET_COLUMNS + _PEOPLE_ABOUT
    for output in session.outputs:
        shape = session.shapes[output]
        if len(session.outputs) == 1 and len(shape) == 3 and shape[2] == wide:
            return str(output)
    return None


def _people(
    session: Session, output: str, layout: str, size: tuple[int, int], joint_set: JointSet
) -> Guess:
    """MoveNet MultiPose and networks of its layout."""
    text = (
        _input(layout, size, f'dtype = "{_whole_or_not(session)}"\n')
        + f'\n[output]\nkind = "people"\nnames = ["{output}"]\n'
        + 'columns = ["y", "x", "confidence"]\nunits = "unit"\n'
        + _joints(joint_set)
        + "\n[calibration]\nraw = [0.0, 0.1, 1.0]\nprobability = [0.0, 0.3, 1.0]\n"
    )
    check: tuple[str, ...] = (
        "values: 0 to 255 in rgb here, without mean and std",
        "order of a joint's numbers: y, x, confidence here, in shares of the input",
        "calibration: MoveNet's confidences are low, and joints count from 0.3 on",
    )
    if None in session.shapes[session.inputs[0]][1:]:
        check = (*check, f"input.size: the network takes others than {size[0]} as well")
    family = f"several people, such as MoveNet MultiPose, {joint_set.name}"
    return Guess(family, text, check, closer="thunder")


def _whole_or_not(session: Session) -> str:
    """The type of an input of bytes."""
    dtype = session.dtypes[session.inputs[0]]
    return "int32" if dtype is not None and dtype.__name__ == "int32" else "float32"


def _blazepose(session: Session, output: str, layout: str, size: tuple[int, int]) -> Guess:
    world = [
        o
        for o in session.outputs
        if len(session.shapes[o]) == 2 and session.shapes[o][1] == 3 * _BLAZEPOSE_ROWS
    ]
    text = (
        _input(layout, size, f'scale = {1 / 255!r}\nturns = "upright"\n')
        + f'\n[output]\nkind = "coordinates"\nnames = ["{output}"]\n'
        + 'columns = ["x", "y", "z", "confidence", "ignored"]\nactivation = "sigmoid"\n'
        + f"rows = {_BLAZEPOSE_ROWS}\n"
        + "".join(f'joints3d = "{o}"\n' for o in world[:1])
        + _joints(BLAZEPOSE33)
    )
    check = ("values: 0 to 1 in rgb here (scale)",)
    return Guess("BlazePose, BlazePose-33", text, check)


def _require_set(session: Session, asked: JointSet | None, joints: JointSet, family: str) -> None:
    """Refuse other joints than those of a family."""
    if asked is not None and asked.name != joints.name:
        raise InputError(
            f"--joints {asked.name}: {session.path} has the outputs of {family}, whose joints are "
            f"{joints.name}; leave it out, or write the manifest by hand"
        )


def _require_count(session: Session, asked: JointSet, counts: list[int]) -> None:
    """Refuse a set of another number of joints than an output has."""
    if len(asked) not in counts:
        raise InputError(
            f"--joints {asked.name}: are {len(asked)} joints, {session.path} has "
            f"{' or '.join(map(str, counts))}; expected a set of that number"
        )


def _by_count(session: Session, count: int | None) -> JointSet:
    joints = _SETS.get(count or 0)
    if joints is None:
        raise InputError(
            f"{session.path}: has {count} joints, which is no set that is known by its number; say "
            "--joints, or write joints.names by hand"
        )
    return joints


def _input(layout: str, size: tuple[int, int], more: str) -> str:
    return f'[input]\nsize = [{size[0]}, {size[1]}]\ncolor = "rgb"\nlayout = "{layout}"\n{more}'


def _joints(joint_set: JointSet) -> str:
    return f'\n[joints]\nset = "{joint_set.name}"\n'
