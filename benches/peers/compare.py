"""Compares the times of stages with compiled code of other libraries, and prints the ratios as Markdown.

    pip install -r benches/peers/requirements.txt
    cargo build --release -p pirouette-bench
    python benches/peers/compare.py [target/release/time-stages]

Both sides get the same rendered photos, seeds, masks, points and meshes, run alternately on one thread, and are
rated by the best of all runs. Conversions for a library are not timed. `bound` is the intended ratio.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[threads] = "1"

import cv2
import igl
import numpy as np
import triangle
from skimage.measure import marching_cubes

TURNS_OF_BOTH = 5
VIEW_COUNT = 8
# Codes of the seeds, in the order background, probable background, probable person, person
GRABCUT_CODES = np.array([cv2.GC_BGD, cv2.GC_PR_BGD, cv2.GC_PR_FGD, cv2.GC_FGD], np.uint8)


def best_ms(runs, work):
    best = float("inf")
    for _ in range(runs):
        start = time.perf_counter()
        result = work()
        best = min(best, (time.perf_counter() - start) * 1e3)
    return best, result


def iou(a, b):
    return np.logical_and(a, b).sum() / np.logical_or(a, b).sum()


class Peers:
    """The same work with other libraries; the results are compared once"""

    def __init__(self, folder):
        self.inputs = json.loads((folder / "inputs.json").read_text())
        self.notes = {}

        def read(kind):
            flag = cv2.IMREAD_COLOR if kind == "photo" else cv2.IMREAD_GRAYSCALE
            return [cv2.imread(str(folder / f"{i:03}_{kind}.png"), flag) for i in range(VIEW_COUNT)]

        self.photos, self.masks = read("photo"), read("mask")
        self.seeds = [GRABCUT_CODES[seeds] for seeds in read("seeds")]
        self.truth = [mask > 127 for mask in read("truth")]
        self.still = [mask > 127 for mask in read("still")]
        self.planar = [self.triangle_input(points) for points in self.inputs["planar"]]
        self.held = [self.arap_input(mesh) for mesh in self.inputs["arap"]]

    def grabcut(self):
        def work():
            results = []
            for photo, seeds in zip(self.photos, self.seeds):
                mask, models = seeds.copy(), (np.zeros((1, 65)), np.zeros((1, 65)))
                cv2.setRNGSeed(1)
                cv2.grabCut(photo, mask, None, *models, 5, cv2.GC_INIT_WITH_MASK)
                results.append((mask & 1) == 1)
            return results

        ms, results = best_ms(1, work)
        ious = [iou(found, truth) for found, truth in zip(results, self.truth)]
        peer = f"{np.mean(ious):.3f} / {min(ious):.3f}"
        for row in ("segment_together", "segment_singly"):
            ours = self.inputs[f"{row}_iou"]
            self.notes[row] = f"IoU mean / worst {np.mean(ours):.3f} / {min(ours):.3f}, theirs {peer}"
        return ms

    def distance_map(self):
        ms, maps = best_ms(5, lambda: [self.distances(mask) for mask in self.masks])
        sums = np.array([distances.sum(dtype=np.float64) for distances in maps])
        off = np.abs(sums / np.array(self.inputs["distance_sums"]) - 1).max()
        self.notes["distance_map"] = f"sums differ by {off:.0e}"
        return ms

    def signed_distance_map(self):
        self.notes["signed_distance_map"] = "theirs: two maps, outside and inside"
        inverse = [255 - mask for mask in self.masks]
        pairs = list(zip(self.masks, inverse))
        return best_ms(5, lambda: [(self.distances(a), self.distances(b)) for a, b in pairs])[0]

    @staticmethod
    def distances(mask):
        return cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)

    def contours(self):
        def work():
            return [cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)[0] for mask in self.masks]

        ms, found = best_ms(5, work)
        counts = [sum(len(contour) for contour in contours) for contours in found]
        same = counts == self.inputs["contour_points"]
        self.notes["contours"] = f"{sum(counts)} points, {'the same number' if same else 'ours differ'}"
        return ms

    @staticmethod
    def triangle_input(points):
        vertices, segments, holes = [], [], []
        for contour in points["contours"]:
            first, count = len(vertices), len(contour)
            vertices += contour
            segments += [(first + i, first + (i + 1) % count) for i in range(count)]
            x, y = np.array(contour).T
            if np.dot(x, np.roll(y, -1)) < np.dot(y, np.roll(x, -1)):
                holes.append(point_inside(np.array(contour)))
        described = {"vertices": np.array(vertices + points["interior"]), "segments": np.array(segments)}
        if holes:
            described["holes"] = np.array(holes)
        return described

    def triangulate(self):
        ms, meshes = best_ms(5, lambda: [triangle.triangulate(points, "pQ") for points in self.planar])
        theirs = sum(len(mesh["triangles"]) for mesh in meshes)
        ours = sum(points["triangle_count"] for points in self.inputs["planar"])
        self.notes["triangulate"] = f"{ours} triangles, theirs {theirs}"
        return ms

    @staticmethod
    def arap_input(mesh):
        as_array = lambda name, kind: np.ascontiguousarray(mesh[name], kind)
        return {
            "rest": as_array("positions", np.float64),
            "triangles": as_array("triangles", np.int64),
            "constrained": as_array("constrained", np.int32),
            "targets": as_array("targets", np.float64),
            "ours": as_array("deformed", np.float64),
        }

    def arap(self):
        def work():
            results = []
            for mesh in self.held:
                data = igl.ARAPData()
                data.max_iter = 20
                data.energy = igl.ARAP_ENERGY_TYPE_SPOKES
                igl.arap_precomputation(mesh["rest"], mesh["triangles"], 2, mesh["constrained"], data)
                results.append(igl.arap_solve(mesh["targets"], data, mesh["rest"].copy()))
            return results

        ms, results = best_ms(3, work)
        # Where obtuse triangles at the outline flip a star at rest, ours preserves it and theirs does not.
        off = np.concatenate(
            [np.abs(found - mesh["ours"]).max(axis=1) for found, mesh in zip(results, self.held)]
        )
        same = (off < 1e-4).mean()
        self.notes["arap"] = f"{same:.0%} of the vertices equal to 1e-4 px (median {np.median(off):.0e})"
        return ms

    def carve(self):
        scene = self.inputs["carve"]
        voxel = scene["voxel_mm"]
        low = np.array(scene["low_mm"]) - 2 * voxel
        counts = np.ceil((np.array(scene["high_mm"]) + 2 * voxel - low) / voxel).astype(int) + 1
        x, y, z = (low[axis] + voxel * np.arange(counts[axis]) for axis in range(3))

        def work():
            inside = np.broadcast_to((y >= 0)[None, :, None], counts).copy()
            for mask, turn in zip(self.still, scene["turns_radians"]):
                # Rotation about the y axis, level camera
                cos, sin = np.cos(turn), np.sin(turn)
                across = cos * x[:, None] + sin * z[None, :]
                depth = scene["distance_mm"] - (cos * z[None, :] - sin * x[:, None])
                per_mm = scene["focal_px"] / depth
                column = np.floor(mask.shape[1] / 2 + across * per_mm).astype(np.int32)
                down = (scene["height_mm"] - y)[None, :, None] * per_mm[:, None, :]
                row = np.floor(mask.shape[0] / 2 + down).astype(np.int32)
                np.clip(column, 0, mask.shape[1] - 1, out=column)
                np.clip(row, 0, mask.shape[0] - 1, out=row)
                inside &= mask[row, column[:, None, :]]
            return marching_cubes(inside.astype(np.float32), 0.5, spacing=(voxel,) * 3)

        assert scene["pitch_radians"] == 0
        ms, (points, faces, *_) = best_ms(1, work)
        a, b, c = (points[faces[:, k]].astype(np.float64) for k in range(3))
        liters = abs(np.einsum("ij,ij->", a, np.cross(b, c))) / 6e6
        self.notes["carve"] = f"{scene['volume_liters']:.1f} liters, theirs {liters:.1f}"
        return ms


def point_inside(polygon):
    """Returns a point inside a simple polygon: the centroid of its largest triangle"""
    count = len(polygon)
    segments = [(i, (i + 1) % count) for i in range(count)]
    mesh = triangle.triangulate({"vertices": polygon, "segments": np.array(segments)}, "pQ")
    corners = mesh["vertices"][mesh["triangles"]]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return corners[np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).argmax()].mean(axis=0)


# Stage, its title, the peer, its method, and the intended speedup
ROWS = [
    ("segment_together", "segmentation, all views together", "`cv2.grabCut`", Peers.grabcut, 8),
    ("segment_singly", "segmentation, each view by itself", "`cv2.grabCut`", Peers.grabcut, 8),
    ("distance_map", "exact distance map", "`cv2.distanceTransform`, precise", Peers.distance_map, 1.5),
    ("signed_distance_map", "signed distance map", "the same, twice", Peers.signed_distance_map, 1.5),
    ("contours", "contours of a mask", "`cv2.findContours`", Peers.contours, 1 / 1.3),
    ("triangulate", "triangulation", "Triangle", Peers.triangulate, 1 / 1.2),
    ("arap", "as-rigid-as-possible, 20 rounds", "libigl", Peers.arap, 3),
    ("carve", "carving and surface, 4 mm", "numpy, `skimage` marching cubes", Peers.carve, 10),
]


def main():
    binary = sys.argv[1] if len(sys.argv) > 1 else "target/release/time-stages"
    cv2.setNumThreads(1)
    ours, theirs = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        peers = None
        for _ in range(TURNS_OF_BOTH):
            printed = subprocess.run([binary, folder], check=True, capture_output=True, text=True).stdout
            for stage, ms in json.loads(printed).items():
                ours[stage] = min(ms, ours.get(stage, ms))
            peers = peers or Peers(Path(folder))
            done = {}
            for stage, _, _, work, _ in ROWS:
                ms = done[work] if work in done else done.setdefault(work, work(peers))
                theirs[stage] = min(ms, theirs.get(stage, ms))
    print("| stage, 8 views | beside | ours, ms | theirs, ms | times faster | bound | |")
    print("|---|---|---:|---:|---:|---:|---|")
    for stage, name, peer, _, bound in ROWS:
        ratio = theirs[stage] / ours[stage]
        note = peers.notes[stage]
        print(
            f"| {name} | {peer} | {ours[stage]:.2f} | {theirs[stage]:.2f} | {ratio:.2f} | {bound:.2f} | {note} |"
        )
    slowest = ours["register_slowest_view"]
    print(f"| registration, slowest view | | {slowest:.2f} | | | 5 ms | |")


if __name__ == "__main__":
    main()
