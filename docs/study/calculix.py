#!/usr/bin/env python3
"""Knead's equilibrium against CalculiX on the same tets: the press block of README.md, half as deep.

Needs numpy, CalculiX (Debian: calculix-ccx) and the program press_tets (ninja -C build/release press_tets):

  docs/study/calculix.py --press-tets build/release/study/press_tets --out out/calculix [--depth 4] [--stiff 3000]

The block is [-0.5, 0.5]^2 x [0, 1], its bottom pinned, nothing held, no friction. A rigid ball of radius 0.35 over (0.03, 0.02) is pressed 0.175 into the
top. CalculiX: C3D4, NEO HOOKE with C10 = mu / 2 and D1 = 2 / K, the ball as fixed wedges of the same triangles, contact at nodes by a linear penalty whose
stiffness, in units of the shear modulus over the block's edge, is --stiff. Skips, with status 0 and a message, where ccx is not installed.
"""
import argparse
import pathlib
import shutil
import subprocess
import sys
import time

import numpy as np

BALL, RADIUS, POISSON, DENT = (0.03, 0.02, 1.175), 0.35, 0.45, 0.175
MATERIALS = ("stable_neo_hookean", "corotated", "edges")


def lines(rows):
    return "\n".join(", ".join(str(v) for v in row) for row in rows)


def write_deck(path, nodes, tets, faces, ball_nodes, ball_faces, stiff):
    """The ball starts where it just touches the block and is moved down."""
    lower = np.where(ball_nodes[:, 2] < BALL[2] - 0.05, True, False)
    cap = ball_faces[lower[ball_faces].all(axis=1)]
    used = np.unique(cap)
    number = np.full(len(ball_nodes), -1)
    number[used] = np.arange(len(used))
    start = ball_nodes[used] + (0, 0, DENT)
    centre = np.array(BALL) + (0, 0, DENT)
    first = len(nodes) + 1
    inner, outer = first, first + len(used)
    points = np.vstack([nodes, centre + 0.8 * (start - centre), start])
    wedges = np.hstack([inner + number[cap], outer + number[cap]])
    # The face of the tet that has a face of the boundary: S1 123, S2 142, S3 243, S4 341.
    sides = {frozenset(f): None for f in map(tuple, faces)}
    contact = []
    for t, tet in enumerate(tets):
        for s, corners in enumerate(((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)), 1):
            face = tet[list(corners)]
            if frozenset(face) in sides and (nodes[face, 2] > 1 - 1e-6).all():
                contact.append((t + 1, f"S{s}"))
    pinned = np.flatnonzero(nodes[:, 2] < 1e-6) + 1
    mu = 1.0
    bulk = mu * (2 * POISSON / (1 - 2 * POISSON) + 2 / 3)
    path.write_text(f"""*NODE, NSET=ALL
{lines((i + 1, *("%.9g" % v for v in p)) for i, p in enumerate(points))}
*ELEMENT, TYPE=C3D4, ELSET=BODY
{lines((i + 1, *(t + 1)) for i, t in enumerate(tets))}
*ELEMENT, TYPE=C3D6, ELSET=BALL
{lines((len(tets) + i + 1, *w) for i, w in enumerate(wedges))}
*NSET, NSET=PINNED
{lines((v,) for v in pinned)}
*NSET, NSET=FLESH, GENERATE
1, {len(nodes)}
*NSET, NSET=RIGID, GENERATE
{first}, {len(points)}
*SURFACE, NAME=TOP
{lines(contact)}
*SURFACE, NAME=UNDER
BALL, S2
*MATERIAL, NAME=SOFT
*HYPERELASTIC, NEO HOOKE
{mu / 2:.9g}, {2 / bulk:.9g}
*MATERIAL, NAME=HARD
*ELASTIC
1000., 0.3
*SOLID SECTION, ELSET=BODY, MATERIAL=SOFT
*SOLID SECTION, ELSET=BALL, MATERIAL=HARD
*SURFACE INTERACTION, NAME=TOUCH
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
{stiff:.9g}, {0.001 * mu:.9g}
*CONTACT PAIR, INTERACTION=TOUCH, TYPE=NODE TO SURFACE
TOP, UNDER
*BOUNDARY
PINNED, 1, 3
*STEP, NLGEOM, INC=2000
*STATIC
0.05, 1., 1e-7, 0.1
*BOUNDARY
RIGID, 1, 2
RIGID, 3, 3, {-DENT}
*NODE PRINT, NSET=FLESH, FREQUENCY=100000
U
*END STEP
""")


def read_displacements(path, count):
    """The last block of U in a .dat file."""
    blocks, rows = [], []
    for line in path.read_text().splitlines():
        words = line.split()
        if "displacements" in line:
            rows = []
            blocks.append((float(words[-1]), rows))
        elif len(words) == 4:
            rows.append([float(w) for w in words])
    if not blocks:
        return 0, None
    time_reached, rows = blocks[-1]
    table = np.array(rows)
    moved = np.zeros((count, 3))
    moved[table[:, 0].astype(int) - 1] = table[:, 1:]
    return time_reached, moved


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--press-tets", required=True)
    parser.add_argument("--out", required=True)
    parser.add_argument("--depth", type=int, default=4)
    parser.add_argument("--stiff", type=float, default=3000)
    parser.add_argument("--keep", action="store_true", help="use the displacements that CalculiX left in --out")
    arguments = parser.parse_args()
    if shutil.which("ccx") is None:
        print("skipped: ccx is not installed (Debian: apt-get install calculix-ccx)")
        return 0
    out = pathlib.Path(arguments.out)
    out.mkdir(parents=True, exist_ok=True)
    print(subprocess.run([arguments.press_tets, str(arguments.depth), str(POISSON), *map(str, BALL), str(RADIUS), str(out)], check=True,
                         capture_output=True, text=True).stdout, end="")
    nodes, ball_nodes = np.loadtxt(out / "nodes.txt"), np.loadtxt(out / "ball_nodes.txt")
    tets, faces, ball_faces = (np.loadtxt(out / f"{name}.txt", dtype=int) for name in ("tets", "faces", "ball_faces"))
    if not arguments.keep:
        write_deck(out / "press.inp", nodes, tets, faces, ball_nodes, ball_faces, arguments.stiff)
        start = time.time()
        with open(out / "ccx.log", "w") as log:
            done = subprocess.run(["ccx", "-i", "press"], cwd=out, stdout=log, stderr=subprocess.STDOUT)
        print(f"ccx ended with {done.returncode} after {time.time() - start:.1f} s")
    reached, theirs = read_displacements(out / "press.dat", len(nodes))
    if reached < 1 - 1e-9:
        print(f"CalculiX stopped at {reached:.3f} of the way: see {out / 'ccx.log'}")
        return 1
    boundary = np.unique(faces)
    surface = nodes[boundary]
    top = surface[:, 2] > 1 - 1e-6

    def depth_of(points):
        return np.maximum(0, RADIUS - np.linalg.norm(points - np.array(BALL), axis=1)).max()

    def volume(points):
        a, b, c, d = (points[tets[:, k]] for k in range(4))
        return (np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6).sum()

    print(f"H: {len(nodes)} vertices, {len(tets)} tets, {len(boundary)} on the surface; dent {DENT}")
    print(f"CalculiX: deepest vertex {depth_of(surface + theirs[boundary]):.2e}, volume {volume(nodes + theirs) / volume(nodes):.5f}, "
          f"deepest displacement {-theirs[:, 2].min():.4f}")
    print("material            RMS / dent  max / dent  RMS of the top / dent  volume   deepest vertex")
    for material in MATERIALS:
        ours = np.loadtxt(out / f"{material}.txt")
        off = np.linalg.norm(ours - nodes - theirs, axis=1)[boundary]
        rms = lambda values: np.sqrt((values**2).mean())
        print(f"{material:20s}{rms(off) / DENT:9.3%}{off.max() / DENT:12.3%}{rms(off[top]) / DENT:22.3%}   {volume(ours) / volume(nodes):.5f}"
              f"  {depth_of(ours[boundary]):.2e}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
