#!/usr/bin/env python3
"""Presses at random places: ten meshes of the test data, each by a ball, a box, a fist and a pin, at three places, 8 % of the diagonal deep.

    docs/study/presses.py --knead build/release/app/knead --data ../shared/data --out out/presses [--set NAME=VALUE ...] [--mesh spot_2930.obj ...]

Writes a table of all presses that are not as they should be (at rest, no tet inside out, no face deeper than 1e-3 of the diagonal), and the totals.
Pictures of the frames are in --out."""
import argparse
import json
import pathlib
import subprocess

import numpy as np

MESHES = ("heads/head_ict_2400.obj", "heads/head_makehuman_2400.obj", "organic/spot_2930.obj", "organic/cat_7949.obj", "organic/hand_7993.obj",
          "organic/koala_49999.obj", "organic/penguin_3362.obj", "organic/wingnut_3047.obj", "press/block20.obj", "colliders/torus.obj")
DEPTH = 0.08  # of the diagonal
PLACES = 3


def read_obj(path):
    points, faces = [], []
    for line in path.read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            points.append([float(w) for w in words[1:4]])
        elif words[:1] == ["f"]:
            corners = [int(w.split("/")[0]) - 1 for w in words[1:]]
            faces += [(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)]
    return np.array(points), np.array(faces)


def normals_of(points, faces):
    a, b, c = (points[faces[:, k]] for k in range(3))
    vectors = np.cross(b - a, c - a)
    normals = np.zeros_like(points)
    for k in range(3):
        np.add.at(normals, faces[:, k], vectors)
    if np.einsum("ij,ij->", a, vectors) < 0:
        normals = -normals
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)


def turn_to(normal):
    """The rotation that takes +y to the normal."""
    axis = np.cross([0, 1, 0], normal)
    degrees = float(np.degrees(np.arccos(np.clip(normal[1], -1, 1))))
    return {"axis": [float(x) for x in axis] if np.linalg.norm(axis) > 1e-9 else [1, 0, 0], "degrees": degrees}


def collider_of(kind, size, data):
    """A node, and how far its lowest point along its own -y is below the origin."""
    if kind == "ball":
        return {"type": "primitive", "shape": "sphere", "radius": 0.12 * size}, 0.12 * size
    if kind == "box":
        return {"type": "primitive", "shape": "box", "size": [0.2 * size] * 3, "resolution": 8}, 0.1 * size
    if kind == "pin":
        return {"type": "primitive", "shape": "capsule", "radius": 0.015 * size, "height": 0.4 * size, "resolution": 12}, None
    return {"type": "read_mesh", "path": str(data / "colliders/fist_3000.obj")}, None


def graph(mesh, kind, data, settings):
    points, faces = read_obj(data / mesh)
    size = float(np.linalg.norm(points.max(0) - points.min(0)))
    normals = normals_of(points, faces)
    random = np.random.default_rng([MESHES.index(mesh), ("ball", "box", "fist", "pin").index(kind)])
    node, below = collider_of(kind, size, data)
    nodes = {"body": {"type": "read_mesh", "path": str(data / mesh)}, "shape": node}
    scale = 1.0
    if kind == "fist":
        p, _ = read_obj(data / "colliders/fist_3000.obj")
        scale = 0.25 * size / float(np.linalg.norm(p.max(0) - p.min(0)))
        below = -scale * float(p[:, 1].min())
    if kind == "pin":
        below = 0.2 * size  # half the height; checked against the primitive's own box below
    keys = {}
    for frame, v in enumerate(random.choice(len(points), PLACES, replace=False), 1):
        at = points[v] + normals[v] * (below - DEPTH * size)
        keys[frame] = {"translate": [float(x) for x in at], "rotate": turn_to(normals[v])}
    nodes["there"] = {"type": "transform", "mesh": "shape", "scale": scale, "keys": keys}
    nodes["solid"] = {"type": "mesh_to_sdf", "mesh": "there"}
    nodes["press"] = {"type": "deform_equilibrium", "surface": "body", "sdf": "solid", **settings}
    nodes["look"] = {"type": "write_picture", "surface": "press.surface", "rest": "body", "path": f"{pathlib.Path(mesh).stem}_{kind}.##.png"}
    return {"knead": 1, "frames": f"1-{PLACES}", "nodes": nodes}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--knead", type=pathlib.Path, required=True)
    parser.add_argument("--data", type=pathlib.Path, required=True)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--mesh", action="append", help="only these, by a part of their names")
    parser.add_argument("--kind", action="append", help="only these: ball, box, fist, pin")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter of deform_equilibrium")
    args = parser.parse_args()
    settings = {name: json.loads(value) for name, value in (s.split("=", 1) for s in args.set)}
    args.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for mesh in MESHES:
        if args.mesh and not any(m in mesh for m in args.mesh):
            continue
        for kind in args.kind or ("ball", "box", "fist", "pin"):
            name = f"{pathlib.Path(mesh).stem}_{kind}"
            path = args.out / f"{name}.json"
            path.write_text(json.dumps(graph(mesh, kind, args.data.resolve(), settings), indent=1))
            done = subprocess.run([args.knead, "run", path, "-q", "--out", args.out / name], capture_output=True, text=True, check=False)
            lines = (args.out / name / "stats.jsonl").read_text().splitlines() if done.returncode == 0 else []
            if len(lines) != PLACES:
                print(f"{name}: exit {done.returncode}: {done.stderr.strip()[-300:]}")
            for line in map(json.loads, lines):
                report = line["nodes"]["press.figures"]["report"]
                warnings = [w for node in line["nodes"].values() for w in node.get("warnings", [])]
                rows.append((f"{name} {line['frame']}", report, len(warnings)))
    print("| press | ended | iterations | ms | inverted | vertices | faces | volume | undecided | enclosed | warnings |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    good = 0
    for name, r, warnings in rows:
        faces = r.get("penetration_faces_max_relative", 0)
        fine = r["ended"] in ("at rest", "rounding", "no contact") and r["inverted_tets"] == 0 and faces <= 1e-3
        good += fine
        if not fine:
            print(f"| {name} | {r['ended']} | {r.get('iterations', 0):.0f} | {r.get('solve_milliseconds', 0):.0f} | {r['inverted_tets']:.0f} | "
                  f"{r['penetration_max_relative']:.1e} | {faces:.1e} | {r.get('volume_error', 0):.1e} | {r.get('undecided_colliders', 0):.0f} | "
                  f"{r.get('enclosed_colliders', 0):.0f} | {warnings} |")
    at_rest = sum(r["ended"] in ("at rest", "rounding", "no contact") for _, r, _ in rows)
    print(f"\n{good} of {len(rows)} as they should be; {at_rest} at rest, {sum(r['inverted_tets'] > 0 for _, r, _ in rows)} with tets inside out, "
          f"{sum(r.get('penetration_faces_max_relative', 0) > 1e-3 for _, r, _ in rows)} with faces inside; "
          f"iterations {np.median([r.get('iterations', 0) for _, r, _ in rows]):.0f} (median), "
          f"{np.median([r.get('solve_milliseconds', 0) for _, r, _ in rows]):.0f} ms")


if __name__ == "__main__":
    main()
