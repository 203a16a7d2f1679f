#!/usr/bin/env python3
"""compare_reading.py OLD NEW [PAIRS]: two programs `knead` read a torus of 1.3 million triangles in every format, by turns.

Prints for each format the least time that read_mesh took in either, and the median of the pairs' ratios, new over old.
"""
import json
import math
import os
import statistics
import struct
import subprocess
import sys
import tempfile

AROUND, ACROSS = 1140, 570


def torus():
    points, triangles = [], []
    for i in range(AROUND):
        a = 2 * math.pi * i / AROUND
        for j in range(ACROSS):
            b = 2 * math.pi * j / ACROSS
            r = 1 + 0.4 * math.cos(b) + 0.01 * math.sin(17 * a + 9 * b)
            points.append(struct.unpack("3f", struct.pack("3f", r * math.cos(a), r * math.sin(a), 0.4 * math.sin(b))))
            here, next_i = i * ACROSS + j, (i + 1) % AROUND * ACROSS + j
            next_j, both = i * ACROSS + (j + 1) % ACROSS, (i + 1) % AROUND * ACROSS + (j + 1) % ACROSS
            triangles += [(here, next_i, both), (here, both, next_j)]
    return points, triangles


def write_all(folder):
    points, triangles = torus()
    texts = ["%.9g %.9g %.9g" % p for p in points]
    lines = "\n".join(texts) + "\n" + "\n".join("3 %d %d %d" % t for t in triangles) + "\n"
    header = ("ply\nformat %s 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
              "element face %d\nproperty list uchar int vertex_indices\nend_header\n")
    files = {
        "a.obj": "\n".join("v " + t for t in texts) + "\n" + "\n".join("f %d %d %d" % (a + 1, b + 1, c + 1) for a, b, c in triangles) + "\n",
        "a.off": "OFF\n%d %d 0\n" % (len(points), len(triangles)) + lines,
        "ascii.ply": header % ("ascii", len(points), len(triangles)) + lines,
        "ascii.stl": "solid a\n" + "".join("facet normal 0 0 1\nouter loop\n" + "".join("vertex " + texts[v] + "\n" for v in t) +
                                            "endloop\nendfacet\n" for t in triangles) + "endsolid a\n",
        "binary.stl": b" " * 80 + struct.pack("<I", len(triangles)) +
                      b"".join(struct.pack("<12fH", 0, 0, 1, *points[a], *points[b], *points[c], 0) for a, b, c in triangles),
    }
    for name, order in (("little", "<"), ("big", ">")):
        files[name + ".ply"] = ((header % ("binary_%s_endian" % name, len(points), len(triangles))).encode() +
                                b"".join(struct.pack(order + "3f", *p) for p in points) +
                                b"".join(struct.pack(order + "B3i", 3, *t) for t in triangles))
    for name, contents in files.items():
        with open(os.path.join(folder, name), "wb") as out:
            out.write(contents if isinstance(contents, bytes) else contents.encode())
    return sorted(files)


def seconds(program, folder, name):
    with open(os.path.join(folder, "graph.yaml"), "w") as graph:
        graph.write("knead: 1\nframes: 1\nnodes:\n  mesh: {type: read_mesh, path: %s}\n" % name)
    stats = os.path.join(folder, "stats.jsonl")
    if os.path.exists(stats):
        os.remove(stats)
    subprocess.run([program, "run", "graph.yaml", "-q", "--threads", "1", "--stats", "stats.jsonl"], cwd=folder, check=True, capture_output=True)
    with open(stats) as lines:
        line = json.loads(lines.readline())
    return line["nodes"]["mesh"]["seconds"] if "nodes" in line else line["times"]["mesh"]


def main():
    old, new = (os.path.realpath(program) for program in sys.argv[1:3])
    pairs = int(sys.argv[3]) if len(sys.argv) > 3 else 9
    with tempfile.TemporaryDirectory() as folder:
        for name in write_all(folder):
            times = [(seconds(old, folder, name), seconds(new, folder, name)) for _ in range(pairs)]
            ratio = statistics.median(after / before for before, after in times)
            print("%-12s %.3f s before, %.3f s now, %.2f of before" % (name, min(t[0] for t in times), min(t[1] for t in times), ratio), flush=True)


if __name__ == "__main__":
    main()
