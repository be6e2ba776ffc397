"""glTF in one file (.glb): a skeleton with joint rotations and a figure of bones that follows it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._atomic import atomic_write
from skelsplat._optional import require
from skelsplat._skeleton import Animation
from skelsplat.io.poses._animation import Bones, animated
from skelsplat.io.poses._pose_data import Poses

# Where a bone of the figure is thickest, and how thick, relative to its length.
_WAIST, _THICK = 0.15, 0.08
_COLOUR = [0.85, 0.45, 0.2, 1.0]


def write_glb(
    path: str | os.PathLike[str],
    data: Poses,
    *,
    frame_rate: float | None = None,
    up: npt.ArrayLike | None = None,
    limbs: Bones | None = None,
) -> None:
    """Write the poses as a skinned figure that moves, in metres with y up, as glTF 2.0 wants it.

    Skeleton and arguments are those of `write_bvh`.
    """
    gltf = require("pygltflib", ".glb files")
    animation = animated(data, "glTF", frame_rate, "m", up, limbs)
    file = _File(gltf)
    skeleton = animation.skeleton
    count = len(skeleton.names)
    for k, name in enumerate(skeleton.names):
        begin = animation.moves[k][0] if k in animation.moves else skeleton.offsets[k]
        children = skeleton.children(k)
        file.nodes.append(gltf.Node(name=name, translation=begin.tolist(), children=children))
    file.nodes.append(gltf.Node(name="Figure", mesh=0, skin=0))
    rest = _at_rest(animation)
    inverse = np.tile(np.eye(4), (count, 1, 1))
    inverse[:, 3, :3] = -rest  # by columns
    matrices = file.add(inverse.reshape(count, 16), "MAT4")
    file.skins.append(gltf.Skin(joints=[*range(count)], skeleton=0, inverseBindMatrices=matrices))
    file.add_figure(*_figure(animation, rest))
    file.add_animation(animation)
    with atomic_write(path) as stream:
        stream.write(b"".join(file.whole().save_to_bytes()))


class _File:
    """A glTF document and its binary part, while they grow."""

    def __init__(self, gltf: Any) -> None:
        self._gltf, self._blob = gltf, bytearray()
        self._accessors: list[Any] = []
        self._views: list[Any] = []
        self._meshes: list[Any] = []
        self._animations: list[Any] = []
        self.nodes: list[Any] = []
        self.skins: list[Any] = []

    def add(self, values: npt.NDArray[Any], kind: str) -> int:
        """Store rows of a kind, such as VEC3, and return the number of their accessor."""
        is_index = values.dtype == np.uint16
        stored = values if is_index else values.astype(np.float32)
        rows = stored.reshape(len(stored), -1)
        self._views.append(
            self._gltf.BufferView(buffer=0, byteOffset=len(self._blob), byteLength=stored.nbytes)
        )
        self._blob += stored.tobytes() + bytes(-stored.nbytes % 4)
        component = self._gltf.UNSIGNED_SHORT if is_index else self._gltf.FLOAT
        self._accessors.append(
            self._gltf.Accessor(
                bufferView=len(self._views) - 1,
                componentType=component,
                count=len(rows),
                type=kind,
                min=rows.min(axis=0).tolist(),
                max=rows.max(axis=0).tolist(),
            )
        )
        return len(self._accessors) - 1

    def add_figure(self, points: Array, normals: Array, joints: npt.NDArray[np.uint16]) -> None:
        """Add triangles with corners (V, 3) that follow one joint each."""
        of_joint, weights = np.zeros((len(points), 4), np.uint16), np.zeros((len(points), 4))
        of_joint[:, 0], weights[:, 0] = joints, 1.0
        attributes = self._gltf.Attributes(
            POSITION=self.add(points, "VEC3"),
            NORMAL=self.add(normals, "VEC3"),
            JOINTS_0=self.add(of_joint, "VEC4"),
            WEIGHTS_0=self.add(weights, "VEC4"),
        )
        primitive = self._gltf.Primitive(attributes=attributes, material=0)
        self._meshes.append(self._gltf.Mesh(primitives=[primitive]))

    def add_animation(self, animation: Animation) -> None:
        """Add the places of free parts, and the rotation of every part that turns."""
        times = self.add(np.arange(len(animation.turns))[:, None] / animation.frame_rate, "SCALAR")
        paths = [(k, "translation", self.add(move, "VEC3")) for k, move in animation.moves.items()]
        for k, turns in enumerate(np.moveaxis(animation.turns, 1, 0)):
            if animation.skeleton.children(k):
                paths.append((k, "rotation", self.add(_quaternions(turns), "VEC4")))
        samplers = [self._gltf.AnimationSampler(input=times, output=output) for _, _, output in paths]
        channels = [
            self._gltf.AnimationChannel(
                sampler=i, target=self._gltf.AnimationChannelTarget(node=k, path=path)
            )
            for i, (k, path, _) in enumerate(paths)
        ]
        self._animations.append(self._gltf.Animation(name="Motion", samplers=samplers, channels=channels))

    def whole(self) -> Any:
        """Return the document."""
        surface = self._gltf.PbrMetallicRoughness(baseColorFactor=_COLOUR, metallicFactor=0.0)
        document = self._gltf.GLTF2(
            asset=self._gltf.Asset(generator=f"skelsplat {sk.__version__}"),
            scene=0,
            scenes=[self._gltf.Scene(nodes=[0, len(self.nodes) - 1])],
            nodes=self.nodes,
            meshes=self._meshes,
            skins=self.skins,
            animations=self._animations,
            materials=[self._gltf.Material(pbrMetallicRoughness=surface)],
            accessors=self._accessors,
            bufferViews=self._views,
            buffers=[self._gltf.Buffer(byteLength=len(self._blob))],
        )
        document.set_binary_blob(bytes(self._blob))
        return document


def _quaternions(turns: Array) -> Array:
    """Return unit quaternions (T, 4), x y z w, of rotations (T, 3, 3), without jumps of sign."""
    transform = require("scipy.spatial.transform", ".glb files")
    values: Array = transform.Rotation.from_matrix(turns).as_quat()
    values[1:] *= np.where((values[1:] * values[:-1]).sum(axis=1) < 0.0, -1.0, 1.0).cumprod()[:, None]
    return values


def _at_rest(animation: Animation) -> Array:
    """Return where the parts begin (K, 3) in the rest pose; free ones as in the first frame."""
    places = animation.skeleton.offsets.copy()
    for k, move in animation.moves.items():
        places[k] = move[0]
    for k, parent in enumerate(animation.skeleton.parents):
        places[k] += places[parent] if parent >= 0 else 0.0
    return places


def _figure(animation: Animation, rest: Array) -> tuple[Array, Array, npt.NDArray[np.uint16]]:
    """Return corners and normals (V, 3) of a slim octahedron along every bone, and the joint it follows."""
    skeleton, free = animation.skeleton, animation.moves
    ends = [(int(parent), rest[k]) for k, parent in enumerate(skeleton.parents) if k not in free]
    ends += [(k, rest[k] + tip) for k, tip in skeleton.tips.items()]
    corners, joints = [], []
    for k, end in ends:
        triangles = _octahedron(rest[k], end)
        corners.append(triangles)
        joints.append(np.full(len(triangles) * 3, k, np.uint16))
    every = np.concatenate(corners)
    normals = np.cross(every[:, 1] - every[:, 0], every[:, 2] - every[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return every.reshape(-1, 3), normals.repeat(3, axis=0), np.concatenate(joints)


def _octahedron(begin: Array, end: Array) -> Array:
    """Return the triangles (8, 3, 3) of a bone, corners anticlockwise from outside."""
    along = end - begin
    across = np.cross(along, np.eye(3)[int(np.abs(along).argmin())])
    length = float(np.linalg.norm(along)) or 1.0
    across *= _THICK * length / max(float(np.linalg.norm(across)), 1e-12)
    other = np.cross(along / length, across)
    middle = begin + _WAIST * along
    ring: Sequence[Array] = [middle + way for way in (across, other, -across, -other)]
    sides = zip(ring, [*ring[1:], ring[0]], strict=True)
    return np.array([corners for a, b in sides for corners in ((begin, b, a), (end, a, b))])
