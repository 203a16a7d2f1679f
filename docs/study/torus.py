#!/usr/bin/env python3
"""The shape of a body whose surface is not H's own: a torus squeezed between two plates, against CalculiX.

Needs numpy; CalculiX (Debian: calculix-ccx) only for --reference. From the root of the tree:

  docs/study/torus.py --knead build/release/app/knead --out out/torus [--reference]

The torus (ring 0.6, tube 0.25, axis y) is squeezed to 60 % of its height, without friction. Its contour at rest is a circle of angle `angle` about the tube's
middle; torus_contour.csv has where each angle goes in CalculiX, for Poisson's ratio 0.45 and 0.499: a wedge of C3D20R of the upper half, NEO HOOKE with C10 = mu / 2
and D1 = 2 / K, a rigid plate over it, contact by a linear penalty (10,000 mu a unit of length for 0.45: the plate is 1.7e-4 inside; 3,000 mu for 0.499: 5.6e-4).
A row is the RMS distance of Knead's vertices from that contour, over the way of one plate, 0.1, and the force on a plate over CalculiX's.
"""
import argparse
import json
import math
import pathlib
import shutil
import subprocess

import numpy as np

RING, TUBE, HALF = 0.6, 0.25, 0.15
FORCE = {"0.45": 2.1046, "0.499": 2.1962}  # on a plate in CalculiX, over the shear modulus
YOUNG = 2.9  # over the shear modulus, of Knead's poisson_ratio of 0.45
DIAGONAL_SQUARED = 8 * (RING + TUBE) ** 2 + 4 * TUBE**2
HERE = pathlib.Path(__file__).parent


def half_disc(n):
    """Quadratic quads of the upper half of the unit disc: points, quads of eight nodes, and (quad, side) of those on the circle."""
    inner = lambda i, j: (0.55 * (i / n - 1) * (1 + 0.2 * (1 - (j / n) ** 2)), 0.55 * j / n * (1 + 0.2 * (1 - (i / n - 1) ** 2)))
    around = [(2 * n, j) for j in range(n)] + [(2 * n - i, n) for i in range(2 * n)] + [(0, n - j) for j in range(n + 1)]

    def ring(k, l):
        angle, at = math.pi * k / (4 * n), inner(*around[k])
        return tuple((1 - l / n) * a + l / n * b for a, b in zip(at, (math.cos(angle), math.sin(angle))))

    quads = [[inner(i, j), inner(i + 1, j), inner(i + 1, j + 1), inner(i, j + 1)] for i in range(2 * n) for j in range(n)]
    quads += [[ring(k, l), ring(k, l + 1), ring(k + 1, l + 1), ring(k + 1, l)] for k in range(4 * n) for l in range(n)]
    number, points, table, outer = {}, [], [], []

    def node(p):
        key = tuple(round(v * 1e9) for v in p)
        if key not in number:
            number[key] = len(points)
            points.append(p)
        return number[key]

    for quad in quads:
        row, middles = [node(p) for p in quad], []
        for side in range(4):
            p, q = np.array(quad[side]), np.array(quad[(side + 1) % 4])
            middle = 0.5 * (p + q)
            if max(abs(math.hypot(*p) - 1), abs(math.hypot(*q) - 1)) < 1e-9:
                middle /= math.hypot(*middle)
                outer.append((len(table), side))
            middles.append(node(tuple(middle)))
        table.append(row + middles)
    return np.array(points), np.array(table), outer


def run_calculix(out, poisson, stiff, n=4, wedge=0.03):
    points, quads, outer = half_disc(n)
    radius, height, number, nodes = RING + TUBE * points[:, 0], TUBE * points[:, 1], {}, []

    def node(i, layer):
        if (i, layer) not in number:
            angle = 0.5 * wedge * layer
            nodes.append((radius[i] * math.cos(angle), height[i], radius[i] * math.sin(angle)))
            number[i, layer] = len(nodes)
        return number[i, layer]

    bricks = [[node(i, layer) for half, layer in ((0, 0), (0, 2), (4, 0), (4, 2)) for i in q[half:half + 4]] + [node(i, 1) for i in q[:4]] for q in quads]
    flesh, lines = len(nodes), lambda rows: "\n".join(", ".join(map(str, row)) for row in rows)
    nodes += [(x, y, z) for y in (TUBE, TUBE + 0.1) for x, z in ((0.2, 0.3), (1.4, 0.3), (1.4, -0.5), (0.2, -0.5))]
    base = [v for (i, _), v in number.items() if abs(height[i]) < 1e-9]
    bulk = 2 * poisson / (1 - 2 * poisson) + 2 / 3
    (out / "torus.inp").write_text(f"""*NODE, NSET=ALL
{lines((i + 1, *("%.10g" % v for v in p)) for i, p in enumerate(nodes))}
*ELEMENT, TYPE=C3D20R, ELSET=BODY
{chr(10).join(f"{i + 1}, {', '.join(map(str, b[:10]))},{chr(10)}{', '.join(map(str, b[10:]))}" for i, b in enumerate(bricks))}
*ELEMENT, TYPE=C3D8, ELSET=PLATE
{len(bricks) + 1}, {", ".join(str(flesh + 1 + k) for k in range(8))}
*NSET, NSET=FLESH, GENERATE
1, {flesh}
*NSET, NSET=RIGID, GENERATE
{flesh + 1}, {flesh + 8}
*NSET, NSET=BASE
{lines((v,) for v in base)}
*SURFACE, NAME=SKIN
{lines((quad + 1, f"S{3 + side}") for quad, side in outer)}
*SURFACE, NAME=UNDER
{len(bricks) + 1}, S1
*MATERIAL, NAME=SOFT
*HYPERELASTIC, NEO HOOKE
0.5, {2 / bulk:.9g}
*MATERIAL, NAME=HARD
*ELASTIC
1000., 0.3
*SOLID SECTION, ELSET=BODY, MATERIAL=SOFT
*SOLID SECTION, ELSET=PLATE, MATERIAL=HARD
*SURFACE INTERACTION, NAME=TOUCH
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
{stiff}, 0.001
*CONTACT PAIR, INTERACTION=TOUCH, TYPE=SURFACE TO SURFACE
SKIN, UNDER
*TRANSFORM, NSET=FLESH, TYPE=C
0,0,0,0,1,0
*BOUNDARY
FLESH, 2, 2
*STEP, NLGEOM, INC=2000
*STATIC
0.01, 1., 1e-8, 0.05
*BOUNDARY
BASE, 3, 3
RIGID, 1, 1
RIGID, 3, 3
RIGID, 2, 2, {HALF - TUBE}
*NODE PRINT, NSET=FLESH, FREQUENCY=100000, GLOBAL=YES
U
*NODE PRINT, NSET=RIGID, FREQUENCY=100000, GLOBAL=YES, TOTALS=ONLY
RF
*END STEP
""")
    with open(out / "ccx.log", "w") as log:
        subprocess.run(["ccx", "-i", "torus"], cwd=out, stdout=log, stderr=subprocess.STDOUT)
    moved, force = np.array(nodes[:flesh]), 0.0
    rows = [line.split() for line in (out / "torus.dat").read_text().split("displacements")[-1].splitlines()]
    for row in rows:
        if len(row) == 4 and row[0].isdigit():
            moved[int(row[0]) - 1] += [float(v) for v in row[1:]]
        elif len(row) == 3:
            force = abs(float(row[1])) * 2 * math.pi / wedge
    on = sorted((math.atan2(p[1], p[0]), i) for i, p in enumerate(points) if abs(math.hypot(*p) - 1) < 1e-9)
    at = [moved[number[i, 0] - 1] for _, i in on]
    return np.array([[angle, math.hypot(p[0], p[2]), p[1]] for (angle, _), p in zip(on, at)]), force


def torus_file(out, around, across):
    path = out / f"torus_{around}x{across}.obj"
    with open(path, "w") as file:
        for i in range(around):
            for j in range(across):
                a, b = 2 * math.pi * i / around, 2 * math.pi * j / across
                r = RING + TUBE * math.cos(b)
                file.write(f"v {r * math.cos(a):.9g} {TUBE * math.sin(b):.9g} {r * math.sin(a):.9g}\n")
        at = lambda i, j: i % around * across + j % across + 1
        for i in range(around):
            for j in range(across):
                file.write(f"f {at(i, j)} {at(i, j + 1)} {at(i + 1, j + 1)} {at(i + 1, j)}\n")
    return path


def read_points(path):
    return np.array([[float(v) for v in line.split()[1:4]] for line in path.read_text().splitlines() if line.startswith("v ")])


def distance(points, contour):
    now = np.c_[np.hypot(points[:, 0], points[:, 2]), np.abs(points[:, 1])]
    start, way = contour[:-1], contour[1:] - contour[:-1]
    along = np.clip(((now[:, None] - start) * way).sum(2) / (way * way).sum(1), 0, 1)
    off = np.sqrt((((start + along[..., None] * way) - now[:, None]) ** 2).sum(2).min(1))
    return np.sqrt((off**2).mean()) / (TUBE - HALF)


def run_knead(knead, out, mesh, tets, press, is_weighted):
    plate = lambda side: {"type": "primitive", "shape": "box", "size": [2.4, 0.3, 2.4], "centre": [0, side * (HALF + 0.15), 0], "resolution": 8}
    nodes = {"body": {"type": "read_mesh", "path": str(mesh.resolve())}, "up": plate(1), "down": plate(-1),
             "over": {"type": "mesh_to_sdf", "mesh": "up"}, "under": {"type": "mesh_to_sdf", "mesh": "down"},
             "tets": {"type": "build_tets", "surface": "body", **tets},
             "press": {"type": "equilibrium", "surface": "body", "sdf": ["over", "under"], "tets": "tets", "lattice": "tets.lattice", **press},
             "exact": {"type": "collide_sdf", "mode": "project", "surface": "press.surface", "sdf": ["over", "under"]},
             "figures": {"type": "measure", "surface": "exact.surface", "rest": "body", "tets": "tets", "points": "press.points",
                         "lattice": "tets.lattice", "report": "press.report"},
             "save": {"type": "write_mesh", "surface": "exact.surface", "path": "now.obj"}}
    if is_weighted:
        nodes["press"]["inside"] = "tets.inside"
    (out / "graph.json").write_text(json.dumps({"knead": 1, "frames": "1", "nodes": nodes}))
    subprocess.run([knead, "run", out / "graph.json", "--threads", "1", "--out", out], check=True, capture_output=True)
    reports = json.loads((out / "stats.jsonl").read_text().splitlines()[-1])["nodes"]
    return read_points(out / "now.obj"), {**reports["tets"]["report"], **reports["figures"]["report"]}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--knead", required=True)
    parser.add_argument("--out", required=True)
    parser.add_argument("--reference", action="store_true", help="run CalculiX too, and measure against what it makes now")
    arguments = parser.parse_args()
    out = pathlib.Path(arguments.out)
    out.mkdir(parents=True, exist_ok=True)
    stored = np.loadtxt(HERE / "torus_contour.csv", delimiter=",", skiprows=1)
    contours = {"0.45": stored[:, 1:3], "0.499": stored[:, 3:5]}
    if arguments.reference:
        if shutil.which("ccx") is None:
            print("ccx is not installed (Debian: apt-get install calculix-ccx): the stored contour is taken")
        else:
            for name, stiff in (("0.45", 10000), ("0.499", 3000)):
                contour, FORCE[name] = run_calculix(out, float(name), stiff)
                contours[name] = contour[:, 1:]
    for name, contour in contours.items():
        print(f"CalculiX {name}: inner {contour[-1, 0]:.4f}, outer {contour[0, 0]:.4f}, force {FORCE[name]:.4f}")
    print("| torus | surface_depth | hold | keep_volume | inside | H / M | inner | outer | volume | RMS 0.45 | RMS 0.499 | force | iterations | solve | least V / V0 |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|")
    runs = [(depth, 0, keep, True) for depth in (0, 4, 5) for keep in (True, False)]
    runs += [(4, hold, keep, is_weighted) for hold, is_weighted in ((1, True), (20, True), (0, False)) for keep in (True, False)]
    for size in ((32, 16), (48, 24), (64, 32), (128, 64)):
        mesh = torus_file(out, *size)
        rest = read_points(mesh)
        middle, inner = np.abs(rest[:, 1]) < 1e-6, np.hypot(rest[:, 0], rest[:, 2]) < RING
        for depth, hold, keep, is_weighted in runs:
            now, stats = run_knead(arguments.knead, out, mesh, {"surface_depth": depth}, {"hold": hold, "keep_volume": keep}, is_weighted)
            radius = np.hypot(now[:, 0], now[:, 2])
            off = [f"{100 * distance(now, contours[name]):.1f} %" for name in ("0.45", "0.499")]
            force = stats["contact_force"] * YOUNG * DIAGONAL_SQUARED / FORCE["0.499" if keep else "0.45"] - 1
            print(f"| {size[0]} x {size[1]} | {depth} | {hold} | {keep} | {is_weighted} | {stats['tet_volume'] / stats['surface_volume']:.2f} "
                  f"| {radius[middle & inner].mean():.4f} | {radius[middle & ~inner].mean():.4f} | {1 + stats['volume_error']:.3f} | {off[0]} | {off[1]} "
                  f"| {100 * force:+.1f} % | {stats['iterations']} ({stats['ended']}) | {stats['solve_milliseconds']:.0f} ms | {stats['least_tet_volume']:.2f} |",
                  flush=True)


if __name__ == "__main__":
    main()
