"""H through meshio: what write_tets writes is what meshio reads, and what meshio writes, in all of its dialects, read_tets reads.

usage: meshio_test.py KNEAD FOLDER. Installs meshio into FOLDER/venv; exit status 77 (skipped) says why where that cannot be done.
"""

import subprocess
import sys
from pathlib import Path

SCENE = """knead: 1
frames: 1
nodes:
  body: {{type: primitive, shape: sphere, radius: 1, resolution: 3}}
  h: {{type: {source}, surface: body, {more}}}
  paint: {{type: weights, surface: body, region: plane, normal: [0, 1, 0], point: [0, 0, 0]}}
  o: {{type: write_tets, tets: h.tets, points: h.points, lattice: h.lattice, weights: paint, path: {path}}}
"""
DIALECTS = {
    "zlib.vtu": ("vtu", {"compression": "zlib"}),
    "plain.vtu": ("vtu", {"compression": None}),
    "text.vtu": ("vtu", {"binary": False}),
    "binary42.vtk": ("vtk42", {}),
    "text42.vtk": ("vtk42", {"binary": False}),
    "binary51.vtk": ("vtk51", {}),
    "text51.vtk": ("vtk51", {"binary": False}),
    "binary22.msh": ("gmsh22", {}),
    "text22.msh": ("gmsh22", {"binary": False}),
    "binary41.msh": ("gmsh", {}),
    "text41.msh": ("gmsh", {"binary": False}),
    "pair.node": ("tetgen", {}),
}


def skip(reason):
    print("skipped:", reason)
    sys.exit(77)


def run(knead, folder, **values):
    (folder / "scene.yaml").write_text(SCENE.format(**values))
    done = subprocess.run([knead, "run", "scene.yaml"], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "outside the tet mesh" not in done.stdout + done.stderr
    return done


def check(meshio, numpy, path, like=None):
    mesh = meshio.read(path)
    tets = mesh.cells_dict["tetra"]
    a, b, c, d = (mesh.points[tets[:, k]] for k in range(4))
    volumes = numpy.einsum("ij,ij->i", numpy.cross(b - a, c - a), d - a) / 6
    assert (volumes > 0).all()
    assert set(mesh.point_data) >= {"rest", "weight"}, mesh.point_data.keys()
    assert numpy.allclose(mesh.point_data["rest"], mesh.points)
    assert numpy.allclose(numpy.ravel(mesh.cell_data["rest_volume"][0]), volumes)
    assert numpy.allclose(numpy.ravel(mesh.cell_data["volume_ratio"][0]), 1)
    weight = numpy.ravel(mesh.point_data["weight"])
    assert 0 <= weight.min() < weight.max() <= 1 + 1e-6
    if like is not None:
        assert len(like.points) == len(mesh.points) and len(like.cells_dict["tetra"]) == len(tets)
        assert numpy.isclose(volumes.sum(), check.volume, rtol=1e-5)
    check.volume = volumes.sum()
    return mesh


def main(knead, folder):
    folder = Path(folder)
    venv = folder / "venv"
    if not (venv / "done").exists():
        folder.mkdir(parents=True, exist_ok=True)
        for command in ([sys.executable, "-m", "venv", venv], [venv / "bin/python", "-m", "pip", "install", "-q", "meshio"]):
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode != 0:
                skip("meshio cannot be installed: " + (done.stderr or done.stdout).strip().splitlines()[-1])
        (venv / "done").write_text("")
    if Path(sys.prefix) != venv.resolve():
        sys.exit(subprocess.run([venv / "bin/python", __file__, knead, folder]).returncode)
    import meshio
    import numpy

    mesh = None
    for extension in ("vtu", "vtk", "msh"):
        run(knead, folder, source="build_tets", more="max_depth: 4", path="own." + extension)
        mesh = check(meshio, numpy, folder / ("own." + extension), mesh)
    bare = meshio.Mesh(mesh.points, [("tetra", mesh.cells_dict["tetra"])])
    for name, (file_format, options) in DIALECTS.items():
        meshio.write(folder / name, bare, file_format=file_format, **options)
        run(knead, folder, source="read_tets", more="path: " + name, path="again.vtu")
        check(meshio, numpy, folder / "again.vtu", mesh)
        print("read", name)


if __name__ == "__main__":
    main(*sys.argv[1:])
