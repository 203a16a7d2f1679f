#!/usr/bin/env python3
"""A free tube pinched between two plates, against CalculiX, vertex by vertex: flesh round a hole, whose surface is not H's own.

Needs numpy and CalculiX (Debian: calculix-ccx). From the root of the tree:

  docs/study/tube.py --knead build/release/app/knead --out out/tube

The tube (outer radius 0.25, inner 0.15, length 0.8, axis z) is squeezed to 70 % of its height, without friction. CalculiX has an eighth of it, C3D20R, NEO
HOOKE, a rigid plate over it, contact by a linear penalty. M's vertices are those of the elements' corners on the tube's surface, so that each has a place to
be compared with. RMS: over the surface's vertices, over the way of one plate.
"""
import argparse
import math
import pathlib
import subprocess

import numpy as np

import torus

OUTER, INNER, LONG, HALF = 0.25, 0.15, 0.8, 0.175
PENALTY = {0.45: 1000, 0.499: 1000}


def place(a, r, z, around, through, along):
    """Grid places count half elements: angle from 0 to pi / 2, radius from the inner one, length from the middle."""
    angle, radius = math.pi * a / (4 * around), INNER + (OUTER - INNER) * r / (2 * through)
    return radius * math.cos(angle), radius * math.sin(angle), 0.5 * LONG * z / (2 * along)


def run_calculix(out, poisson, around, through, along):
    """Where each corner (a, r, z), in whole elements, goes, and the force on a plate over the shear modulus."""
    number, nodes, bricks, skin = {}, [], [], []

    def node(at):
        if at not in number:
            nodes.append(place(*at, around, through, along))
            number[at] = len(nodes)
        return number[at]

    for a in range(around):
        for r in range(through):
            for z in range(along):
                ring = [(2 * a, 2 * r), (2 * a, 2 * r + 2), (2 * a + 2, 2 * r + 2), (2 * a + 2, 2 * r)]
                middle = [tuple((p + q) // 2 for p, q in zip(ring[k], ring[(k + 1) % 4])) for k in range(4)]
                low, high = 2 * z, 2 * z + 2
                places = [(*p, low) for p in ring] + [(*p, high) for p in ring]
                places += [(*p, low) for p in middle] + [(*p, high) for p in middle] + [(*p, low + 1) for p in ring]
                bricks.append([node(p) for p in places])
                if r == through - 1:
                    skin.append(len(bricks))
    flesh, lines = len(nodes), lambda rows: "\n".join(", ".join(map(str, row)) for row in rows)
    nodes += [(x, y, z) for y in (OUTER, OUTER + 0.1) for x, z in ((-0.3, 0.7), (0.7, 0.7), (0.7, -0.3), (-0.3, -0.3))]
    on = lambda k: lines((v,) for v in range(1, flesh + 1) if abs(nodes[v - 1][k]) < 1e-9)
    bulk = 2 * poisson / (1 - 2 * poisson) + 2 / 3
    # Face 4 of a brick, its corners 2, 3, 7 and 6, is the outer one.
    (out / "tube.inp").write_text(f"""*NODE, NSET=ALL
{lines((i + 1, *("%.10g" % v for v in p)) for i, p in enumerate(nodes))}
*ELEMENT, TYPE=C3D20R, ELSET=BODY
{chr(10).join(f"{i + 1}, {', '.join(map(str, b[:10]))},{chr(10)}{', '.join(map(str, b[10:]))}" for i, b in enumerate(bricks))}
*ELEMENT, TYPE=C3D8, ELSET=PLATE
{len(bricks) + 1}, {", ".join(str(flesh + 1 + k) for k in range(8))}
*NSET, NSET=FLESH, GENERATE
1, {flesh}
*NSET, NSET=RIGID, GENERATE
{flesh + 1}, {flesh + 8}
*NSET, NSET=X
{on(0)}
*NSET, NSET=Y
{on(1)}
*NSET, NSET=Z
{on(2)}
*SURFACE, NAME=SKIN
{lines((brick, "S4") for brick in skin)}
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
{PENALTY[poisson]}, 0.001
*CONTACT PAIR, INTERACTION=TOUCH, TYPE=SURFACE TO SURFACE
SKIN, UNDER
*BOUNDARY
X, 1, 1
Y, 2, 2
Z, 3, 3
*STEP, NLGEOM, INC=2000
*STATIC
0.01, 1., 1e-8, 0.05
*BOUNDARY
RIGID, 1, 1
RIGID, 3, 3
RIGID, 2, 2, {HALF - OUTER}
*NODE PRINT, NSET=FLESH, FREQUENCY=100000
U
*NODE PRINT, NSET=RIGID, FREQUENCY=100000, TOTALS=ONLY
RF
*END STEP
""")
    with open(out / "ccx.log", "w") as log:
        subprocess.run(["ccx", "-i", "tube"], cwd=out, stdout=log, stderr=subprocess.STDOUT)
    moved, force = np.array(nodes[:flesh]), 0.0
    for row in (line.split() for line in (out / "tube.dat").read_text().split("displacements")[-1].splitlines()):
        if len(row) == 4 and row[0].isdigit():
            moved[int(row[0]) - 1] += [float(v) for v in row[1:]]
        elif len(row) == 3:
            force = abs(float(row[1]))
    corner = {tuple(v // 2 for v in at): moved[i - 1] for at, i in number.items() if all(v % 2 == 0 for v in at)}
    return corner, 4 * force


def tube_file(out, corner, around, through, along):
    """M in full, and where its vertices go."""
    path, vertices, expected, faces = out / f"tube_{4 * around}x{2 * along}.obj", {}, [], []
    file = [f"# {4 * around} x {2 * along}"]

    def vertex(k, r, z):
        k %= 4 * around
        if (k, r, z) not in vertices:
            quarter, rest = divmod(k, around)
            a = around - rest if quarter % 2 else rest
            sign = np.array([-1 if quarter in (1, 2) else 1, -1 if quarter > 1 else 1, -1 if z < 0 else 1])
            file.append("v %.9g %.9g %.9g" % tuple(sign * place(2 * a, 2 * r, 2 * abs(z), around, through, along)))
            expected.append(sign * corner[a, r, abs(z)])
            vertices[k, r, z] = len(vertices) + 1
        return vertices[k, r, z]

    for k in range(4 * around):
        for z in range(-along, along):
            faces.append([vertex(k, through, z), vertex(k + 1, through, z), vertex(k + 1, through, z + 1), vertex(k, through, z + 1)])
            faces.append([vertex(k, 0, z + 1), vertex(k + 1, 0, z + 1), vertex(k + 1, 0, z), vertex(k, 0, z)])
        for r in range(through):
            faces.append([vertex(k, r, along), vertex(k, r + 1, along), vertex(k + 1, r + 1, along), vertex(k + 1, r, along)])
            faces.append([vertex(k + 1, r, -along), vertex(k + 1, r + 1, -along), vertex(k, r + 1, -along), vertex(k, r, -along)])
    path.write_text("\n".join(file + ["f " + " ".join(map(str, f)) for f in faces]) + "\n")
    return path, np.array(expected)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--knead", required=True)
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    out = pathlib.Path(arguments.out)
    out.mkdir(parents=True, exist_ok=True)
    torus.HALF = HALF
    diagonal2 = 8 * OUTER**2 + LONG**2
    print("| tube | surface_depth | tets | H / M | keep_volume, against | RMS | force | force off | iterations | volume | least V / V0 |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for grid in ((6, 2, 6), (9, 2, 8)):
        for poisson, keep in ((0.499, True), (0.45, False)):
            corner, force = run_calculix(out, poisson, *grid)
            mesh, expected = tube_file(out, corner, *grid)
            reference = force / (2.9 * diagonal2)  # Knead's E is that of 0.45 in both
            for depth in (4, 5, 6):
                now, stats = torus.run_knead(arguments.knead, out, mesh, {"surface_depth": depth}, {"keep_volume": keep}, True)
                rms = np.sqrt(((now - expected) ** 2).sum(1).mean()) / (OUTER - HALF)
                print(f"| {4 * grid[0]} x {2 * grid[2]} | {depth} | {stats['tets']:.0f} | {stats['tet_volume'] / stats['surface_volume']:.2f} | {keep}, {poisson} "
                      f"| {100 * rms:.1f} % | {stats['contact_force']:.5f} | {100 * (stats['contact_force'] / reference - 1):+.1f} % "
                      f"| {stats['iterations']} ({stats['ended']}) | {1 + stats['volume_error']:.3f} | {stats['least_tet_volume']:.2f} |", flush=True)


if __name__ == "__main__":
    main()
