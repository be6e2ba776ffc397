"""Calibration files of every format, written from one reference rig by other code than the package's.

OpenCV's ``FileStorage`` writes the YAML and the XML that is OpenCV's; the rest is text as the formats' own
programs write it. Every writer takes a folder and a list of `View` in millimetres and returns the path.
"""

from __future__ import annotations

import json
import pickle
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import scipy.io
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class View:
    """One camera of the reference rig: pixels and millimetres, world → camera, five coefficients."""

    name: str
    K: np.ndarray
    R: np.ndarray
    t: np.ndarray
    size: tuple[int, int]
    distortion: np.ndarray

    @property
    def centre(self) -> np.ndarray:
        return -self.R.T @ self.t


def reference(names, *, distortion=True):
    """Cameras in a ring of 4 m round the origin, every number different."""
    rng = np.random.default_rng(7)
    views = []
    for i, name in enumerate(names):
        angle = 2 * np.pi * (i + 0.3) / len(names)
        eye = np.array([4000 * np.cos(angle), 4000 * np.sin(angle), 1500.0 + 100 * i])
        z = -(eye - [0, 0, 900.0]) / np.linalg.norm(eye - [0, 0, 900.0])
        x = np.cross(z, [0, 0, 1.0])
        x /= np.linalg.norm(x)
        roll = Rotation.from_euler("z", 5.0 + 3.0 * i, degrees=True).as_matrix()
        R = roll @ np.stack([x, np.cross(z, x), z])
        K = np.array([[1140.0 + 7 * i, 0, 510.0 - 4 * i], [0, 1150.0 + 3 * i, 495.0 + 6 * i], [0, 0, 1]])
        lens = np.array([-0.2, 0.15, 0.002, -0.001, 0.01]) * (1 + 0.1 * rng.random(5)) * distortion
        views.append(View(name, K, R, -R @ eye, (1000, 1002 - 2 * (i in (1, 2))), lens))
    return views


def points():
    """Points that every camera of the ring sees, mm."""
    return np.random.default_rng(3).uniform([-500, -500, 300], [500, 500, 1600], (40, 3))


def projected(views):
    """OpenCV's projection of `points`, (M, n, 2)."""
    return np.stack(
        [cv2.projectPoints(points(), cv2.Rodrigues(v.R)[0], v.t, v.K, v.distortion)[0][:, 0] for v in views]
    )


def anipose(folder: Path, views, scale=1e-3):
    text = ""
    for i, v in enumerate(views):
        rotation = Rotation.from_matrix(v.R).as_rotvec()
        text += (
            f'[cam_{i}]\nname = "{v.name}"\nsize = {list(map(float, v.size))}\nmatrix = {v.K.tolist()}\n'
            f"distortions = {v.distortion.tolist()}\nrotation = {rotation.tolist()}\n"
            f"translation = {(v.t * scale).tolist()}\nfisheye = false\n\n"
        )
    path = folder / "Calib.toml"
    path.write_text(text + "[metadata]\nadjusted = false\nerror = 0.0\n")
    return path


def caliscope(folder: Path, views, older=False):
    """Write matrix rotations for even cameras, as older versions do, and one ignored camera."""
    text, table = "", "cam_" if older else "cameras."
    for i, v in enumerate(views):
        rotation = v.R if i % 2 == 0 else Rotation.from_matrix(v.R).as_rotvec()
        text += (
            f"[{table}{i}]\ncam_id = {i}\nrotation_count = {-i}\nerror = 0.19\nexposure = -7.0\n"
            f"grid_count = 24\nignore = false\nsize = {list(v.size)}\nmatrix = {v.K.tolist()}\n"
            f"distortions = {v.distortion.tolist()}\ntranslation = {(v.t / 1000).tolist()}\n"
            f"rotation = {rotation.tolist()}\nverified_resolutions = [[640, 480]]\n\n"
        )
    text += f"[{table}9]\ncam_id = 9\nignore = true\nsize = [640, 480]\nfisheye = false\n"
    path = folder / ("config.toml" if older else "camera_array.toml")
    path.write_text(text)
    return path


def pyxy3d(folder: Path, views):
    """Write Caliscope's older ``config.toml``, which has settings and pairs of cameras besides."""
    path = caliscope(folder, views, older=True)
    path.write_text(
        f"CreationDate = 2023-05-06T11:12:27.631355\nfps_sync_stream_processing = 24\n\n{path.read_text()}"
        '[capture_volume]\nstage = 2\norigin_sync_index = 77\n\n[charuco]\ncolumns = 4\nunits = "inch"\n\n'
        "[stereo_0_1]\nRMSE = 3.2\nrotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\n"
        "translation = [[3.07], [-0.17], [2.39]]\n"
    )
    return path


def voxelpose(folder: Path, views):
    table = {
        v.name: {
            "k": v.distortion[[0, 1, 4], None].tolist(),
            "p": v.distortion[[2, 3], None].tolist(),
            "R": v.R.tolist(),
            "T": v.centre[:, None].tolist(),
            **{"fx": v.K[0, 0], "fy": v.K[1, 1], "cx": v.K[0, 2], "cy": v.K[1, 2]},
        }
        for v in views
    }
    path = folder / "calibration_shelf.json"
    path.write_text(json.dumps(table, indent=2))
    return path


def association(folder: Path, views):
    """Write all three forms of a pose in turn: 12 numbers, a matrix and a vector."""
    table = {}
    for i, v in enumerate(views):
        t = v.t / 1000
        vector = Rotation.from_matrix(v.R).as_rotvec()
        pose = {"R": (v.R.ravel() if i % 3 == 1 else vector).tolist(), "T": t.tolist()}
        table[v.name] = {
            "K": v.K.ravel().tolist(),
            **(pose if i % 3 else {"RT": np.c_[v.R, t].ravel().tolist()}),
            "imgSize": list(v.size),
            "distCoeff": v.distortion.tolist(),
            "rectifyAlpha": 0.0,
        }
    path = folder / "calibration.json"
    path.write_text(json.dumps(table))
    return path


def opencap(folder: Path, views):
    """Write a session: a pickle per camera, heights before widths."""
    for v in views:
        beneath = folder / "Videos" / v.name
        (beneath / "InputMedia").mkdir(parents=True)
        table = {
            "distortion": v.distortion[None],
            "intrinsicMat": v.K,
            "imageSize": np.array([[float(v.size[1])], [float(v.size[0])]]),
            "rotation": v.R,
            "translation": v.t[:, None],
            "rotation_EulerAngles": cv2.Rodrigues(v.R)[0],
        }
        (beneath / "cameraIntrinsicsExtrinsics.pickle").write_bytes(pickle.dumps(table))
    (folder / "Videos" / "mappingCamDevice.pickle").write_bytes(pickle.dumps({"device": 0}))
    return folder


def matlab_camera(v, skew=0.0):
    """Return MATLAB's transposes of a camera, whose first pixel is (1, 1)."""
    K = v.K + np.array([[0.0, skew, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    radial, tangential = v.distortion[[0, 1, 4]], v.distortion[[2, 3]]
    return {"K": K.T, "RDistort": radial[None], "TDistort": tangential[None], "r": v.R.T, "t": v.t[None]}


def cell(values):
    """Return a column of MATLAB's cells."""
    column = np.empty((len(values), 1), dtype=object)
    column[:, 0] = values
    return column


def dannce(folder: Path, views, skew=0.0):
    """Write Label3D's file, with labels besides the cameras."""
    path = folder / "label3d_dannce.mat"
    labels = cell([{"data_2d": np.zeros((2, 4)), "data_frame": np.zeros((1, 2))} for _ in views])
    params = cell([matlab_camera(v, skew) for v in views])
    names = cell([v.name for v in views]).T
    scipy.io.savemat(path, {"params": params, "camnames": names, "labelData": labels, "sync": labels})
    return path


def easymocap(folder: Path, views, header="%YAML:1.0", with_size=True):
    for name in ("intri.yml", "extri.yml"):
        storage = cv2.FileStorage(str(folder / name), cv2.FILE_STORAGE_WRITE)
        storage.startWriteStruct("names", cv2.FileNode_SEQ)
        for v in views:
            storage.write("", v.name)
        storage.endWriteStruct()
        for v in views:
            if name == "intri.yml":
                storage.write(f"K_{v.name}", v.K)
                storage.write(f"dist_{v.name}", v.distortion[None])
                if with_size:
                    storage.write(f"H_{v.name}", v.size[1])
                    storage.write(f"W_{v.name}", v.size[0])
            else:
                storage.write(f"R_{v.name}", Rotation.from_matrix(v.R).as_rotvec()[:, None])
                storage.write(f"Rot_{v.name}", v.R)
                storage.write(f"T_{v.name}", v.t[:, None] / 1000)
        storage.release()
        text = (folder / name).read_text()
        # OpenCV 5 and OpenCV 4 differ in the first line
        (folder / name).write_text(header + text[text.index("\n") :])
    return folder


def openpose(folder: Path, views):
    for v in views:
        storage = cv2.FileStorage(str(folder / f"{v.name}.xml"), cv2.FILE_STORAGE_WRITE)
        storage.write("CameraMatrix", np.hstack([v.R, v.t[:, None] / 1000]))
        storage.write("Intrinsics", v.K)
        storage.write("Distortion", np.append(v.distortion, [0.0, 0.0, 0.0])[:, None])
        storage.release()
    return folder


def panoptic(folder: Path, views):
    cameras = [
        {
            **{"name": v.name, "type": "hd", "resolution": list(v.size), "panel": 0, "node": i},
            **{"K": v.K.tolist(), "distCoef": v.distortion.tolist()},
            **{"R": v.R.tolist(), "t": (v.t[:, None] / 10).tolist()},
        }
        for i, v in enumerate(views)
    ]
    other = {**cameras[0], "name": "01_01", "type": "vga", "resolution": [640, 480]}
    path = folder / "calibration_171204_pose5.json"
    path.write_text(json.dumps({"calibDataSource": "hd", "cameras": [other, *cameras]}))
    return path


def human36m(folder: Path, views):
    document = {
        "intrinsics": {
            v.name: {"calibration_matrix": v.K.tolist(), "distortion": v.distortion.tolist()} for v in views
        },
        "extrinsics": {
            subject: {v.name: {"R": v.R.tolist(), "t": (v.t[:, None] + shift).tolist()} for v in views}
            for subject, shift in (("S1", 50.0), ("S9", 0.0))
        },
    }
    path = folder / "camera-parameters.json"
    path.write_text(json.dumps(document))
    return path


def human36m_h5(folder: Path, views):
    """Write cameras.h5 of 3d-pose-baseline: rotations transposed, texts as the numbers of characters."""
    import h5py

    path = folder / "cameras.h5"
    with h5py.File(path, "w") as file:
        for subject, shift in ((1, 50.0), (9, 0.0)):
            for i, v in enumerate(views):
                group = file.create_group(f"subject{subject}/camera{i + 1}")
                group["R"], group["T"] = v.R.T, (v.centre + shift)[None]
                group["f"], group["c"] = np.diag(v.K)[None, :2], v.K[None, :2, 2]
                group["k"], group["p"] = v.distortion[None, [0, 1, 4]], v.distortion[None, 2:4]
                group["Name"] = np.array([[ord(letter)] for letter in v.name], dtype=np.uint16)
    return path


def colmap(folder: Path, views):
    """Write COLMAP's text: pixels are counted from the corner; some images have points, some none."""
    cameras, images = ["# Camera list with one line of data per camera:"], ["# Image list", ""]
    for i, v in enumerate(views):
        k1, k2, p1, p2, k3 = v.distortion
        numbers = [v.K[0, 0], v.K[1, 1], *(v.K[:2, 2] + 0.5), k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]
        cameras.append(
            f"{i + 1} FULL_OPENCV {v.size[0]} {v.size[1]} {' '.join(map(repr, map(float, numbers)))}"
        )
        pose = np.roll(Rotation.from_matrix(v.R).as_quat(), 1).tolist() + (v.t / 1000).tolist()
        images += [
            f"{7 - i} {' '.join(map(repr, pose))} {i + 1} {v.name}.jpg",
            "12.5 3.5 -1 7.0 2.0 4" * (i % 2),
        ]
    (folder / "cameras.txt").write_text("\n".join(cameras) + "\n")
    (folder / "images.txt").write_text("\n".join(images) + "\n")
    return folder


def kalibr(folder: Path, views, pose="T_cn_cnm1", model="radtan"):
    """Write camchain.yaml as PyYAML does, which breaks long lists; metres."""
    text, before = "", None
    for i, v in enumerate(views):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = v.R, v.t / 1000
        written = {"T_cn_cnm1": None if before is None else T @ np.linalg.inv(before)}
        written = {"T_cam_imu": T, "T_imu_cam": np.linalg.inv(T), **written}[pose]
        before = T
        rows = [] if written is None else [f"  - {row}" for row in written.tolist()]
        k1, k2, p1, p2 = v.distortion[:4].tolist()
        values = [v.K[0, 0], v.K[1, 1], v.K[0, 2], v.K[1, 2]]
        lines = [
            *([f"  {pose}: # from the one before", *rows] if rows else []),
            "  cam_overlaps: [1]",
            "  camera_model: 'pinhole'",
            f"  distortion_coeffs: [{k1}, {k2},",
            f"    {p1}, {p2}]",
            f"  distortion_model: {model}",
            f"  intrinsics: {list(map(float, values))} #fu, fv",
            f"  resolution: {list(v.size)}",
            f"  rostopic: /cam{i}/image_raw",
        ]
        text += "\n".join([f"cam{i}:", *lines]) + "\n"
    path = folder / "camchain.yaml"
    path.write_text(text)
    return path


def stereo(folder: Path, views, form="one.yml", names=("M", "D")):
    """Write OpenCV's stereo calibration of two cameras with its own library: one file, or a pair."""
    first, second = views
    R = second.R @ first.R.T
    lenses = {f"{names[0]}{i + 1}": v.K for i, v in enumerate(views)}
    lenses |= {f"{names[1]}{i + 1}": v.distortion[None] for i, v in enumerate(views)}
    places = {"R": R, "T": (second.t - R @ first.t)[:, None] / 1000, "Q": np.eye(4)}
    suffix = Path(form).suffix
    parts = {f"intrinsics{suffix}": lenses, f"extrinsics{suffix}": places}
    parts = parts if form.startswith("pair") else {form: {**lenses, **places}}
    for name, matrices in parts.items():
        storage = cv2.FileStorage(str(folder / name), cv2.FILE_STORAGE_WRITE)
        for key, matrix in matrices.items():
            storage.write(key, matrix)
        storage.release()
    return folder / next(iter(parts)) if form.startswith("one") else folder


def matrices(folder: Path, views, form="json"):
    """Write P = K [R | t] times any number, in metres."""
    found = {v.name: -2.5 * v.K @ np.c_[v.R, v.t / 1000] for v in views}
    if form == "json":
        path = folder / "projections.json"
        path.write_text(json.dumps({name: P.tolist() for name, P in found.items()}))
        return path
    for name, P in found.items():
        np.savetxt(folder / f"{name}.txt", P, "%.17g")
    return folder


def _qtm(rotation, place, K, lens, more=""):
    """Return the elements of a pose and a lens as Qualisys and Theia3D write them."""
    r = " ".join(f'r{i + 1}{j + 1}="{rotation[i, j]:.6f}"' for i in range(3) for j in range(3))
    k1, k2, p1, p2, k3 = lens
    inner = {
        **{
            "focalLengthU": K[0, 0],
            "focalLengthV": K[1, 1],
            "centerPointU": K[0, 2],
            "centerPointV": K[1, 2],
        },
        **{"radialDistortion1": k1, "radialDistortion2": k2, "radialDistortion3": k3, "skew": 0.0},
        **{"tangentalDistortion1": p1, "tangentalDistortion2": p2},
    }
    shown = " ".join(f'{name}="{value:.6f}"' for name, value in inner.items())
    x, y, z = place
    return f'<transform x="{x:.6f}" y="{y:.6f}" z="{z:.6f}" {r}/><intrinsic focallength="9.3" {more}{shown}/>'


def qualisys(folder: Path, views, *, binning=1.0, left=0, top=0, extra="", parts=64):
    """Six decimals as QTM writes; `left` and `top` cut the image out of a larger sensor."""
    cameras = '<camera active="1" serial="1234" model="Miqus M3" viewrotation="0"/>'
    for v in views:
        full = [round(length * binning) for length in v.size]
        edges = f'left="{left}" top="{top}" right="{left + full[0] - 1}" bottom="{top + full[1] - 1}"'
        K = v.K * parts * binning
        K[:2, 2] = ((v.K[:2, 2] + 0.5) * binning - 0.5 + [left, top]) * parts
        cameras += (
            f'<camera active="1" calibrated="true" avg-residual="0.5" serial="{v.name}" model="Miqus Video" '
            f'viewrotation="0"{extra}><fov_video {edges}/>'
            f"{_qtm(np.diag([1.0, -1.0, -1.0]) @ v.R, v.centre, K, v.distortion)}</camera>"
        )
    path = folder / "Calib.qca.txt"
    path.write_text(
        f"<?xml version='1.0' encoding='ASCII'?>\n<calibration qtm-version=\"2.17\"><cameras>{cameras}"
        "</cameras></calibration>\n"
    )
    return path


def theia(folder: Path, views, dimensions=False):
    """World → camera and pixels, in elements that are called like Qualisys'."""
    cameras = ""
    for v in views:
        w, h = v.size
        ends = f'sensorMinU="0" sensorMaxU="{w}" sensorMinV="0" sensorMaxV="{h}" '
        ends = f'sensorDimU="{w:.6f}" sensorDimV="{h:.6f}" ' if dimensions else ends
        inner = _qtm(v.R, v.t, v.K, v.distortion, ends)
        cameras += f'<camera active="1" serial="{v.name}" viewrotation="0" static_boxes="">{inner}</camera>'
    path = folder / "calibration.txt"
    path.write_text(f"<calibration><results/><cameras>{cameras}</cameras></calibration>\n")
    return path


def vicon(folder: Path, views, radial="0 0 0"):
    cameras = '<Camera DEVICEID="77" TYPE="Vero_MX" SENSOR_SIZE="2048 1088"/>'
    for v in views:
        # scipy's quaternions are scalar last, too
        quaternion = " ".join(f"{q:.15g}" for q in Rotation.from_matrix(v.R).as_quat())
        position = " ".join(f"{c:.10g}" for c in v.centre)
        aspect = v.K[0, 0] / v.K[1, 1]
        cameras += (
            f'<Camera DEVICEID="{v.name}" TYPE="VueVIDEO" SENSOR_SIZE="{v.size[0]} {v.size[1]}" '
            f'PIXEL_ASPECT_RATIO="{aspect:.15g}" SKEW="0"><KeyFrames><KeyFrame FRAME="0" '
            f'FOCAL_LENGTH="{v.K[0, 0]}" PRINCIPAL_POINT="{v.K[0, 2]} {v.K[1, 2]}" '
            f'ORIENTATION="{quaternion}" POSITION="{position}" WORLD_ERROR="0.3" '
            f'VICON_RADIAL2="Vicon3Parameter {v.K[0, 2] + 4} {v.K[1, 2] - 3} {radial}"/></KeyFrames></Camera>'
        )
    path = folder / "session.xcp"
    path.write_text(
        f'<?xml version="1.0" encoding="UTF-8" standalone="no" ?>\n<Cameras>{cameras}</Cameras>\n'
    )
    return path


def own_json(folder: Path, views):
    keys = ("K", "R", "t", "distortion")
    cameras = [
        {"name": v.name, "size": list(v.size), **{key: getattr(v, key).tolist() for key in keys}}
        for v in views
    ]
    path = folder / "rig.json"
    path.write_text(
        json.dumps({"format": "skelsplat-calibration", "version": 1, "unit": "mm", "cameras": cameras})
    )
    return path


def own_npz(folder: Path, views):
    path = folder / "rig.npz"
    keys = {"K": "K", "R": "R", "t": "t", "size": "size", "names": "name", "distortion": "distortion"}
    arrays = {key: np.array([getattr(v, name) for v in views]) for key, name in keys.items()}
    np.savez(path, **{**arrays, "t": arrays["t"] / 1000}, unit="m")
    return path


def openpose_folders(root: Path, rig, detections):
    """Write detections (T, M, N, 2) as OpenPose folders named like the cameras; NaN becomes zeros."""
    for i, name in enumerate(rig.names):
        (root / name).mkdir(parents=True)
        for t, joints in enumerate(detections[:, i]):
            seen = np.isfinite(joints).all(axis=1, keepdims=True)
            values = np.where(seen, np.hstack([np.nan_to_num(joints), np.full(seen.shape, 0.9)]), 0.0)
            person = {"pose_keypoints_2d": values.ravel().tolist()}
            (root / name / f"{t:06d}_keypoints.json").write_text(json.dumps({"people": [person]}))


# formats whose world is a camera, of two cameras, or without a lens: writer and options
OTHERS = {
    "kalibr": (kalibr, {}),
    "opencv-stereo": (lambda folder, views: stereo(folder, views[:2]), {"unit": "m", "size": (1000, 1000)}),
    "matrices": (matrices, {"unit": "m", "size": (1000, 1000)}),
}
NAMES = ["54138969", "55011271", "58860488", "60457274"]
# format → writer, options, names in the rig, unit, largest difference in px (digits that the format keeps)
FULL = 1e-9
FORMATS_WRITTEN = {
    "anipose": (anipose, {"unit": "m"}, NAMES, "m", FULL),
    "caliscope": (caliscope, {}, [f"cam_{i}" for i in range(4)], "m", FULL),
    "voxelpose": (voxelpose, {"size": dict.fromkeys(NAMES, (1000, 1002))}, NAMES, "mm", FULL),
    "4d-association": (association, {"unit": "m"}, NAMES, "m", FULL),
    "opencap": (opencap, {}, NAMES, "mm", FULL),
    "dannce": (dannce, {"size": dict.fromkeys(NAMES, (1000, 1002))}, NAMES, "mm", FULL),
    "easymocap": (easymocap, {"unit": "m"}, NAMES, "m", FULL),
    # the files have no sizes: these are given
    "openpose": (openpose, {"size": dict.fromkeys(NAMES, (1000, 1002))}, NAMES, "m", FULL),
    "panoptic": (panoptic, {}, NAMES, "cm", FULL),
    "human36m": (human36m, {"subject": "S9"}, NAMES, "mm", FULL),
    "human36m-h5": (human36m_h5, {"subject": "S9"}, NAMES, "mm", FULL),
    "colmap": (colmap, {"unit": "m"}, NAMES, "m", FULL),
    # axes to ½·10⁻⁶ at 1150 px and coefficients likewise: below 5·10⁻³ px
    "qualisys": (qualisys, {}, NAMES, "mm", 5e-3),
    "theia": (theia, {}, NAMES, "mm", 5e-3),
    "json": (own_json, {}, NAMES, "mm", FULL),
    "npz": (own_npz, {}, NAMES, "m", FULL),
}
