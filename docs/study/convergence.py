#!/usr/bin/env python3
"""How far from its converged shape each method ends: the figures and plots of docs/convergence.md.

Needs numpy and matplotlib (pip install numpy matplotlib). From the root of the tree:

  docs/study/convergence.py --knead build/release/app/knead --out out/study --mesh PATH --mesh PATH [--anderson build/release/study/anderson]
                            [--only distance|anderson|smooth|depth|scale|sweep|pictures]

Each --mesh is a closed body pressed by a ball from +z; the head and the crush are those of examples/. Everything runs on one thread, so that times
are of the method and not of what else the machine does. Graphs, meshes and results.json stay in --out; tables.md and the plots are made from them.
"""
import argparse
import json
import pathlib
import subprocess

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

LOOP_COUNTS = [10, 20, 30, 60, 90, 120, 180, 250, 500, 1000, 2000]
LOOP_CONVERGED = 6000
EQUILIBRIUM_COUNTS = [2, 5, 10, 12, 14, 16, 18, 20, 25, 30, 40, 60, 80, 100, 150]
EQUILIBRIUM_CONVERGED = 600
LOOPS = {"memory, hold": (1, 1), "memory, no hold": (1, 0), "no memory, hold": (0, 1), "no memory, no hold": (0, 0)}
RED, BLUE = ("#c44e52", "#dd8452", "#937860", "#8c8c8c"), "#1f5fa8"


def read_ply(path):
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    count = next(int(line.split()[2]) for line in data[:end].decode().splitlines() if line.startswith("element vertex"))
    return np.frombuffer(data, "<f4", 3 * count, end).reshape(count, 3).astype(float)


def figures_of(line):
    """A line of stats.jsonl as one table: NODE.FIGURE of every report, and NODE.seconds."""
    figures = {"frame": line["frame"]}
    for name, node in line["nodes"].items():
        figures[name + ".seconds"] = node["seconds"]
        figures.update({f"{name}.{figure}": value for figure, value in node.get("report", {}).items()})
    return figures


class Study:
    def __init__(self, knead, out):
        self.knead, self.out = knead, out

    def run(self, name, nodes, frames="1", anderson=None):
        folder = self.out / name
        folder.mkdir(parents=True, exist_ok=True)
        graph = folder / "graph.json"
        graph.write_text(json.dumps({"knead": 1, "frames": frames, "nodes": nodes}, indent=1))
        (folder / "stats.jsonl").unlink(missing_ok=True)  # a run keeps the lines of other frames
        command = [anderson, graph, folder] if anderson else [self.knead, "run", graph, "--threads", "1", "--out", folder]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"{name}: {done.stdout}{done.stderr}")
        return folder, [figures_of(json.loads(line)) for line in (folder / "stats.jsonl").read_text().splitlines()]


class Scene:
    """Nodes `body`, `motion` or others for the pictures, and the colliders' fields."""

    def __init__(self, name, nodes, sdf, depth, stiffness, hard, lift=None, volume=None, hold=0.02, own_hold=0.02):
        self.name, self.nodes, self.sdf, self.depth, self.stiffness, self.hard = name, nodes, sdf, depth, stiffness, hard
        self.hold, self.own_hold = hold, own_hold  # of the loop: for the variants with hold, and as the example has it
        self.lift, self.volume = lift or {}, volume or {"relaxation": 0.4, "sweeps": 2}

    def graph(self, **tets):
        return dict(self.nodes, tets={"type": "build_tets", "surface": "body", "max_depth": self.depth, **tets})

    def results(self, nodes, name, write=True):
        nodes[name + "_exact"] = {"type": "collide_sdf", "mode": "project", "surface": name + ".surface", "sdf": self.sdf}
        nodes[name + "_m"] = {"type": "measure", "surface": name + "_exact.surface", "rest": "body", "sdf": self.sdf, "tets": "tets",
                              "points": name + ".points", "lattice": "tets.lattice", "report": name + ".report"}
        if write:
            nodes[name + "_w"] = {"type": "write_mesh", "surface": name + "_exact.surface", "path": name + ".####.ply"}

    def loop(self, nodes, name, rounds, before=None, rate=1.0, hold=None, threshold=0.0):
        """The paper's loop, from rest or on from where the loop `before` ended: the same bits as in one go."""
        start = {"points": "tets.points", "surface": "body", "memory": "way" if rate else None}
        nodes["way"] = {"type": "approach", "surface": "body", "sdf": self.sdf}
        nodes[name] = {
            "type": "iterate", "max_iterations": rounds, "threshold": threshold,
            "state": {port: f"{before}.{port}" for port in start} if before else start,
            "body": {
                "push": {"type": "collide_sdf", "surface": "state.surface", "sdf": self.sdf, "memory": "state.memory", "memory_rate": rate}
                if rate else {"type": "collide_sdf", "surface": "state.surface", "sdf": self.sdf},
                "lift": {"type": "map_to_tets", "displacement": "push.displacement", "points": "state.points", "lattice": "tets.lattice",
                         "tets": "tets", **self.lift},
                "volume": {"type": "restore_volume", "points": "lift", "tets": "tets", **self.volume},
                "stiff": {"type": "enforce_stiffness", "points": "volume", "tets": "tets", "stiffness": self.stiffness},
                "held": {"type": "hold", "points": "stiff", "tets": "tets", "lattice": "tets.lattice",
                         "strength": self.own_hold if hold is None else hold},
                "map": {"type": "map_to_surface", "points": "held", "lattice": "tets.lattice"},
            },
            "next": {"points": "held", "surface": "map", "memory": "push.memory"},
        }
        self.results(nodes, name)

    def accelerate(self, nodes, name, before):
        """Turns a loop into one with Anderson acceleration, for the program `anderson` to run."""
        loop = nodes[name]
        loop["state"]["history"] = f"{before}.history" if before else None
        loop["body"]["mixed"] = {"type": "anderson", "before": "state.points", "after": "held", "history": "state.history"}
        loop["body"]["map"]["points"] = "mixed.points"
        loop["next"].update(points="mixed.points", history="mixed.history")

    def equilibrium(self, nodes, name, **settings):
        nodes[name] = {"type": "equilibrium", "surface": "body", "sdf": self.sdf, "tets": "tets", "lattice": "tets.lattice", **settings}
        self.results(nodes, name)


def moved(place, further):
    """Keys that make what hangs on them depend on the frame, so that its times are the frame's."""
    return {1: {"translate": list(place)}, 2: {"translate": [p + f for p, f in zip(place, further)]}}


def head_scene(height=2.0, depth=6, resolution=0):
    s = height / 2
    return Scene("head", {
        "body": {"type": "primitive", "shape": "head", "height": height, "resolution": resolution},
        "fist": {"type": "primitive", "shape": "fist", "height": 0.6 * s},
        "hard": {"type": "transform", "mesh": "fist", "rotate": [-90, 0, 0], "keys": moved((0.28 * s, 0, 0.72 * s), (0, 0, s))},
        "solid": {"type": "mesh_to_sdf", "mesh": "hard"}}, ["solid"], depth, 0.15, ["hard"])


def crush_scene(depth=4, resolution=0):
    nodes = {"body": {"type": "primitive", "shape": "sphere", "radius": 1, "resolution": resolution},
             "block": {"type": "primitive", "shape": "box", "size": [6, 4, 6], "resolution": 6}}
    for name, side in (("upper", 1), ("lower", -1)):
        nodes[name] = {"type": "transform", "mesh": "block", "keys": moved((0, side * 2.27, 0), (0, side, 0))}
        nodes[name + "_sdf"] = {"type": "mesh_to_sdf", "mesh": name}
    return Scene("crush", nodes, ["upper_sdf", "lower_sdf"], depth, 0.2, ["upper", "lower"], {"max_step": 0.1}, {"sweeps": 6, "regularisation": 0.05},
                 hold=0.002, own_hold=0)


def ball_scene(study, name, body, keys_of, depth=6):
    """A ball of a seventh of the diagonal, put by `keys_of(tip, diagonal, radius)` where the body reaches furthest along z."""
    folder, _ = study.run(name + "_rest", {"body": body, "rest": {"type": "write_mesh", "surface": "body", "path": "rest.ply"}})
    points = read_ply(folder / "rest.ply")
    diagonal = np.linalg.norm(points.max(0) - points.min(0))
    radius = diagonal / 7
    keys = keys_of(points[points[:, 2].argmax()], diagonal, radius)
    return Scene(name, {"body": body, "ball": {"type": "primitive", "shape": "sphere", "radius": radius, "resolution": 5},
                        "hard": {"type": "transform", "mesh": "ball", "keys": keys}, "solid": {"type": "mesh_to_sdf", "mesh": "hard"}},
                 ["solid"], depth, 0.15, ["hard"])


def mesh_scene(study, path):
    def keys(tip, diagonal, radius):
        return moved(tip + (0, 0, radius - 0.06 * diagonal), (0, 0, diagonal))
    return ball_scene(study, path.stem, {"type": "read_mesh", "path": str(path)}, keys)


def scenes(study, meshes):
    yield head_scene()
    yield crush_scene()
    for path in meshes:
        yield mesh_scene(study, path)


def distance(a, b, dent):
    off = np.linalg.norm(a - b, axis=1) / dent
    return float(np.sqrt((off**2).mean())), float(off.max())


def seconds_each(study, scene, runs=5):
    """Of an iteration of the loop and of `equilibrium`: the least of several runs, since other work on the machine only adds time."""
    loops, solves = [], []
    for _ in range(runs):
        nodes = scene.graph()
        scene.loop(nodes, "loop", 100)
        scene.equilibrium(nodes, "eq")
        _, (stats,) = study.run("time_" + scene.name, nodes)
        loops.append(stats["loop.seconds"] / 100)
        solves.append(stats["eq.solve_milliseconds"] * 1e-3 / stats["eq.iterations"])
    return min(loops), min(solves)


def study_distance(study, meshes, results, done):
    """Adds a scene at a time to `results`; those that are there are left as they are."""
    for scene in scenes(study, meshes):
        if scene.name in results:
            continue
        nodes = scene.graph()
        nodes["rest"] = {"type": "write_mesh", "surface": "body", "path": "rest.ply"}
        for k, (rate, held) in enumerate(LOOPS.values()):
            hold = held * scene.hold
            before, made = None, 0
            for rounds in LOOP_COUNTS + [LOOP_CONVERGED]:
                name = f"loop{k}_{rounds}"
                scene.loop(nodes, name, rounds - made, before, rate, hold)
                before, made = name, rounds
            scene.loop(nodes, f"loop{k}_stop", 250, None, rate, hold, 1e-4)
        for count in EQUILIBRIUM_COUNTS:
            scene.equilibrium(nodes, f"eq_{count}", max_iterations=count, threshold=1e-6, displacement=0, penetration=0)
        scene.equilibrium(nodes, "eq_converged", max_iterations=EQUILIBRIUM_CONVERGED, threshold=1e-6, displacement=0, penetration=0)
        scene.equilibrium(nodes, "eq_stop")
        folder, (stats,) = study.run("distance_" + scene.name, nodes)
        shape = lambda name: read_ply(folder / f"{name}.0001.ply")
        rest, converged = read_ply(folder / "rest.ply"), shape("eq_converged")
        dent_of = lambda points: float(np.linalg.norm(points - rest, axis=1).max())
        dent = dent_of(converged)

        def entry(name, target, seconds):
            rms, largest = distance(shape(name), target, dent)
            return {"iterations": stats[name + "_m.iterations"], "ended": stats[name + "_m.ended"], "rms": rms, "max": largest, "seconds": seconds,
                    "to_equilibrium": distance(shape(name), converged, dent)[0], "volume_error": stats[name + "_m.volume_error"],
                    "inverted": stats[name + "_m.inverted_tets"], "raw_penetration": stats[name + "_exact.penetration_max_relative"]}

        result = {"dent": dent, "tets": stats["tets.tets"], "diagonal": float(np.linalg.norm(np.ptp(rest, axis=0))), "loops": {}}
        names = [f"eq_{count}" for count in EQUILIBRIUM_COUNTS]
        each_round, each_solve = seconds_each(study, scene)
        solve = lambda name: each_solve * stats[name + "_m.iterations"]
        result["equilibrium"] = {"sweep": [entry(name, converged, solve(name)) for name in names],
                                 "stop": entry("eq_stop", converged, solve("eq_stop")),
                                 "converged": entry("eq_converged", converged, solve("eq_converged")),
                                 "converged_gradient": stats["eq_converged_m.gradient"], "prepare": stats["eq_stop_m.prepare_milliseconds"] * 1e-3}
        for k, variant in enumerate(LOOPS):
            names = [f"loop{k}_{count}" for count in LOOP_COUNTS + [LOOP_CONVERGED]]
            target = shape(names[-1])
            sweep = [dict(entry(name, target, each_round * count), iterations=count) for name, count in zip(names, LOOP_COUNTS)]
            stop = entry(f"loop{k}_stop", target, each_round * stats[f"loop{k}_stop_m.iterations"])
            last = entry(names[-1], shape(names[-2]), each_round * LOOP_CONVERGED)
            result["loops"][variant] = {"sweep": sweep, "stop": stop, "last": last, "unrest": stats[names[-1] + "_m.unrest"]}
        results[scene.name] = result
        print(scene.name, "done", flush=True)
        done()
    return results


def study_anderson(study, program, rounds=(10, 20, 30, 60, 120, 250, 500, 1000)):
    """The loop with Anderson acceleration beside the plain one, both against the plain one's last shape."""
    result = {}
    for scene in (head_scene(), crush_scene()):
        for hold in (scene.hold, 0):
            nodes = scene.graph()
            nodes["rest"] = {"type": "write_mesh", "surface": "body", "path": "rest.ply"}
            scene.equilibrium(nodes, "eq")
            for kind in ("plain", "anderson"):
                before, made = None, 0
                for count in rounds:
                    name = f"{kind}_{count}"
                    scene.loop(nodes, name, count - made, before, 1, hold)
                    if kind == "anderson":
                        scene.accelerate(nodes, name, before)
                    before, made = name, count
            folder, _ = study.run(f"anderson_{scene.name}_{hold:g}", nodes, anderson=program)
            shape = lambda name: read_ply(folder / f"{name}.0001.ply")
            dent = np.linalg.norm(shape("eq") - read_ply(folder / "rest.ply"), axis=1).max()
            result[f"{scene.name}, hold {hold:g}"] = {
                kind: [distance(shape(f"{kind}_{count}"), shape(f"plain_{rounds[-1]}"), dent)[0] for count in rounds] for kind in ("plain", "anderson")}
    return {"rounds": rounds, "scenes": result}


def study_smooth(study, frames=13):
    """A ball moved on a straight line, a thousandth of the diagonal a frame: deep in another ball, and over the head's nose from before it touches."""
    step = 2 * 3**0.5 / 1000

    def into_ball(tip, diagonal, radius):
        centre = np.array((0.03, 0.02, 1 + 0.5 - 0.32))
        return {1: {"translate": list(centre)}, frames: {"translate": list(centre - (0, 0, (frames - 1) * step))}}

    def over_nose(tip, diagonal, radius):
        way = np.array((0.6, 0, -0.8)) * diagonal / 1000
        start = tip + (0, 0, radius + 0.003 * diagonal)
        return {1: {"translate": list(start)}, frames: {"translate": list(start + (frames - 1) * way)}}

    bodies = {"ball": ({"type": "primitive", "shape": "sphere", "radius": 1}, into_ball), "nose": ({"type": "primitive", "shape": "head"}, over_nose)}
    tight = {"threshold": 1e-5, "displacement": 1e-6, "penetration": 1e-5, "max_iterations": 400}
    kinds = {"loop": ("the paper's loop, at its stopping rule", {}), "gap_0": ("equilibrium, contact_gap 0", {"contact_gap": 0}),
             "gap_1": ("equilibrium, contact_gap 1e-3", {"contact_gap": 1e-3}), "gap_2": ("equilibrium (contact_gap 2e-3)", {}),
             "tight_1": ("equilibrium, tight", tight),
             "corotated": ("equilibrium, corotated", {"material": "corotated"}), "edges": ("equilibrium, edges", {"material": "edges"})}
    result = {}
    for name, (body, keys) in bodies.items():
        scene = ball_scene(study, "smooth_" + name, body, keys)
        if name == "ball":
            scene.nodes["ball"]["radius"] = 0.5
        nodes = scene.graph()
        nodes["rest"] = {"type": "write_mesh", "surface": "body", "path": "rest.ply"}
        for kind, (title, settings) in kinds.items():
            if kind == "loop":
                scene.loop(nodes, kind, 250, threshold=1e-4)
            else:
                scene.equilibrium(nodes, kind, **settings)
            nodes[kind + "_raw"] = {"type": "write_mesh", "surface": kind + ".surface", "path": kind + "_raw.####.ply"}
        folder, stats = study.run("smooth_" + name, nodes, f"1-{frames}")
        length = np.linalg.norm(np.ptp(read_ply(folder / "rest.ply"), axis=0)) / 1000

        def jolts(files):
            shapes = np.array([read_ply(folder / f"{files}.{frame:04d}.ply") for frame in range(1, frames + 1)])
            return [float(j) for j in np.linalg.norm(shapes[2:] - 2 * shapes[1:-1] + shapes[:-2], axis=2).max(axis=1) / length]

        result[name] = {title: {"frames": list(range(2, frames)), "raw": jolts(kind + "_raw"), "projected": jolts(kind),
                                "iterations": float(np.mean([line[kind + "_m.iterations"] for line in stats]))} for kind, (title, _) in kinds.items()}
    return result


def study_depth(study):
    """On finer bodies than the examples', and with cells split down to single vertices: else there would be nothing to make H finer for."""
    result = {}
    for make, resolution, depths in ((head_scene, 60, (4, 5, 6, 7)), (crush_scene, 5, (4, 5, 6, 7))):
        shapes, rows = {}, {}
        for depth in depths:
            scene = make(depth=depth, resolution=resolution)
            nodes = scene.graph(max_vertices=1)
            scene.equilibrium(nodes, "eq", max_iterations=300)
            gradient_alone = {"threshold": 1e-3, "displacement": 1, "penetration": 1, "max_iterations": 300}
            scene.equilibrium(nodes, "gradient", **gradient_alone)
            nodes["coarse"] = dict(nodes["tets"], max_depth=depth - 2)
            nodes["first"] = {**nodes["eq"], "tets": "coarse", "lattice": "coarse.lattice", "threshold": 1e-2, "displacement": 1e-2, "penetration": 2e-2}
            nodes["first_m"] = {"type": "measure", "surface": "first.surface", "rest": "body", "report": "first.report"}
            scene.equilibrium(nodes, "started", start="first.state", max_iterations=300)
            scene.equilibrium(nodes, "started_gradient", start="first.state", **gradient_alone)
            if depth < 7:
                scene.loop(nodes, "loop", 250, threshold=1e-4)
            nodes["rest"] = {"type": "write_mesh", "surface": "body", "path": "rest.ply"}
            folder, (stats,) = study.run(f"depth_{scene.name}_{depth}", nodes)
            shapes[depth] = {name: read_ply(folder / f"{name}.0001.ply") for name in ("eq", "started", "loop")[: 3 if depth < 7 else 2]}
            shapes[depth]["rest"] = read_ply(folder / "rest.ply")
            rows[depth] = {"tets": stats["tets.tets"], "depth": stats["tets.depth"], "iterations": stats["eq_m.iterations"], "ended": stats["eq_m.ended"],
                           "to_gradient": stats["gradient_m.iterations"], "gradient_ended": stats["gradient_m.ended"],
                           "first": stats["first_m.iterations"], "started_to_gradient": stats["started_gradient_m.iterations"],
                           "started": stats["started_m.iterations"], "started_ended": stats["started_m.ended"],
                           "volume_error": stats["eq_m.volume_error"], "inverted": stats["eq_m.inverted_tets"],
                           "seconds": stats["eq_m.solve_milliseconds"] * 1e-3, "raw_penetration": stats["eq_exact.penetration_max_relative"]}
            print(scene.name, depth, rows[depth], flush=True)
        dents = {depth: np.linalg.norm(made["eq"] - made["rest"], axis=1).max() for depth, made in shapes.items()}
        for depth, a in shapes.items():
            rows[depth]["apart"] = distance(a["eq"], a["started"], dents[depth])
            if b := shapes.get(depth + 1):
                rows[depth]["next"] = {name: distance(a[name], b[name], dents[depth + 1]) for name in ("eq", "loop") if name in b}
        result[scene.name] = rows
    return result


SWEEP = 2.5  # from 1.25 above the middle of a ball of radius 1 to 1.25 below, along -y


def study_sweep(study, steps=1000):
    """A small ball through a large one, in at the top, through the middle, out at the bottom; each frame by itself."""
    result = {}
    for name, settings in {"told from the rest shape": {}, "entry given": {"entry": [0, -1, 0]}}.items():
        keys = {1: {"translate": [0.05, SWEEP / 2, 0.02]}, steps + 1: {"translate": [0.05, -SWEEP / 2, 0.02]}}
        nodes = {"body": {"type": "primitive", "shape": "sphere", "radius": 1}, "ball": {"type": "primitive", "shape": "sphere", "radius": 0.2, "resolution": 5},
                 "hard": {"type": "transform", "mesh": "ball", "keys": keys}, "solid": {"type": "mesh_to_sdf", "mesh": "hard"}}
        scene = Scene("sweep", nodes, ["solid"], 4, 0.15, ["hard"])
        nodes = scene.graph()
        scene.equilibrium(nodes, "eq", **settings)
        nodes["eq_raw"] = {"type": "write_mesh", "surface": "eq.surface", "path": "raw.####.ply"}
        folder, stats = study.run("sweep_" + ("given" if settings else "told"), nodes, f"1-{steps + 1}")
        stats.sort(key=lambda line: line["frame"])
        figures = ("ended", "iterations", "solve_milliseconds", "undecided_colliders", "enclosed_colliders", "contacts", "inverted_tets", "displacement_max")
        row = {figure: [line["eq_m." + figure] for line in stats] for figure in figures}
        for kind, files in (("raw", "raw"), ("projected", "eq")):
            shapes = (read_ply(folder / f"{files}.{frame:04d}.ply") for frame in range(1, steps + 2))
            before, row[kind] = next(shapes), []
            for shape in shapes:
                row[kind].append(float(np.linalg.norm(shape - before, axis=1).max() / (SWEEP / steps)))
                before = shape
        result[name] = row
    return result


def study_scale(study):
    """The same head at the size of a mouse's and a whale's, relative to its height."""
    shapes = {}
    for height in (2.0, 0.02, 60.0):
        scene = head_scene(height)
        nodes = scene.graph()
        scene.equilibrium(nodes, "eq")
        scene.loop(nodes, "loop", 250, threshold=1e-4)
        nodes["rest"] = {"type": "write_mesh", "surface": "body", "path": "rest.ply"}
        folder, (stats,) = study.run(f"scale_{height:g}", nodes)
        shapes[height] = {name: read_ply(folder / f"{name}.0001.ply") * 2 / height for name in ("eq", "loop")}
        shapes[height].update(rest=read_ply(folder / "rest.ply") * 2 / height, iterations=stats["eq_m.iterations"])
    dent = np.linalg.norm(shapes[2.0]["eq"] - shapes[2.0]["rest"], axis=1).max()
    return {f"{height:g}": {"iterations": s["iterations"], **{name: distance(s[name], shapes[2.0][name], dent) for name in ("rest", "eq", "loop")}}
            for height, s in shapes.items() if height != 2.0}


def study_pictures(study):
    for scene in (head_scene(), crush_scene()):
        nodes = scene.graph()
        scene.loop(nodes, "loop", 250, threshold=1e-4)
        scene.equilibrium(nodes, "equilibrium")
        view = [0.9, 0.3, 0.6] if scene.name == "head" else [0.3, 0.25, 1]
        for name in ("loop", "equilibrium"):
            nodes[name + "_picture"] = {"type": "write_picture", "surface": name + "_exact.surface", "rest": "body", "colliders": scene.hard,
                                        "look": "hidden", "view": view, "zoom": 1.6 if scene.name == "head" else 0.9,
                                        "width": 420, "height": 340, "path": name + ".png"}
        study.run("pictures_" + scene.name, nodes)


def plot_distance(results, path):
    figure, axes = plt.subplots(len(results), 2, figsize=(9, 2.5 * len(results)), sharey=True, constrained_layout=True, squeeze=False)
    for row, (name, result) in zip(axes, results.items()):
        for axis, what, label in zip(row, ("iterations", "seconds"), ("iterations", "seconds, one thread")):
            for colour, (variant, loop) in zip(RED, result["loops"].items()):
                axis.loglog([s[what] for s in loop["sweep"]], [s["rms"] for s in loop["sweep"]], color=colour, lw=1.2, label="loop: " + variant)
                axis.plot(loop["stop"][what], loop["stop"]["rms"], "o", color=colour, ms=4)
            equilibrium = result["equilibrium"]
            axis.loglog([s[what] for s in equilibrium["sweep"]], [s["rms"] for s in equilibrium["sweep"]], color=BLUE, lw=2, label="equilibrium")
            axis.plot(equilibrium["stop"][what], equilibrium["stop"]["rms"], "o", color=BLUE, ms=6)
            axis.axhline(0.01, color="black", lw=0.6, ls=":")
            axis.set_title(name, fontsize=9)
            axis.set_xlabel(label, fontsize=8)
            axis.tick_params(labelsize=7)
            axis.set_ylim(1e-5, 1)
        row[0].set_ylabel("RMS distance to own\nconverged shape / dent", fontsize=8)
    axes[0][0].legend(fontsize=6, loc="lower left")
    figure.savefig(path, dpi=85)


def plot_smooth(results, path):
    figure, axes = plt.subplots(1, 2, figsize=(9.5, 3.2), sharey=True, constrained_layout=True)
    shown = {"the paper's loop, at its stopping rule": RED[0], "equilibrium, contact_gap 0": "#7fa8d6", "equilibrium (contact_gap 2e-3)": BLUE,
             "equilibrium, contact_gap 1e-3": "#0b2f5c", "equilibrium, tight": "#55a868"}
    for axis, (name, series) in zip(axes, results.items()):
        for title, colour in shown.items():
            axis.semilogy(series[title]["frames"], np.maximum(series[title]["raw"], 1e-4), color=colour, lw=1.2, label=title)
        axis.axhline(0.02, color="black", lw=0.6, ls=":")
        axis.set_title(name, fontsize=9)
        axis.set_xlabel("frame; the ball moves by 1/1000 of the diagonal a frame", fontsize=8)
        axis.tick_params(labelsize=7)
    axes[0].set_ylabel("largest second difference\nof a vertex / step", fontsize=8)
    axes[0].legend(fontsize=6)
    figure.savefig(path, dpi=85)


def plot_pictures(study, path):
    figure, axes = plt.subplots(2, 2, figsize=(7.2, 5.8))
    for row, scene in zip(axes, ("head", "crush")):
        for axis, name in zip(row, ("loop", "equilibrium")):
            axis.imshow(plt.imread(study.out / f"pictures_{scene}" / f"{name}.png"))
            axis.set_title(f"{scene}: {'the paper’s loop' if name == 'loop' else name}", fontsize=8)
            axis.axis("off")
    figure.subplots_adjust(0.01, 0.01, 0.99, 0.95, 0.02, 0.08)
    figure.savefig(path, dpi=100)


def percent(value):
    return f"{100 * value:.2g} %"


def first_below(sweep, limit=0.01):
    """From where on the distance stays below the limit."""
    found = None
    for step in reversed(sweep):
        if step["rms"] > limit:
            break
        found = step
    return f"{found['iterations']} its, {found['seconds']:.2g} s" if found else "never"


def tables(results):
    text = []
    if "distance" in results:
        text += ["| scene | method | ended | iterations | s | RMS / dent | max / dent | under 1 % from | to the equilibrium | volume | "
                 "inside before `project` | inverted |",
                 "|---|---|---|---|---|---|---|---|---|---|---|---|"]
        for name, result in results["distance"].items():
            rows = {"equilibrium": result["equilibrium"], **{"loop: " + k: v for k, v in result["loops"].items()}}
            for method, row in rows.items():
                s = row["stop"]
                text.append(f"| {name} | {method} | {s['ended']} | {s['iterations']} | {s['seconds']:.2g} | {percent(s['rms'])} | "
                            f"{percent(s['max'])} | {first_below(row['sweep'])} | {percent(s['to_equilibrium'])} | {percent(s['volume_error'])} | {s['raw_penetration']:.1e} | {s['inverted']} |")
    if "anderson" in results:
        rounds = results["anderson"]["rounds"]
        text += ["", "| scene | loop | " + " | ".join(map(str, rounds)) + " |", "|---|---" + "|---" * len(rounds) + "|"]
        text += [f"| {scene} | {kind} | " + " | ".join(map(percent, off)) + " |"
                 for scene, kinds in results["anderson"]["scenes"].items() for kind, off in kinds.items()]
    if "depth" in results:
        text += ["", "| scene | depth | tets | to gradient 1e-3 | to rest | s | volume | inverted | off the next depth | loop: off the next depth | "
                 "coarser H | from it to gradient | to rest | apart |", "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|"]
        for name, rows in results["depth"].items():
            for depth, r in rows.items():
                following = [percent(r["next"][k][0]) if k in r.get("next", {}) else "" for k in ("eq", "loop")]
                text.append(f"| {name} | {depth} | {r['tets']} | {r['to_gradient']} | {r['iterations']} ({r['ended']}) | {r['seconds']:.2g} | {percent(r['volume_error'])} | "
                            f"{r['inverted']} | {' | '.join(following)} | {r['first']} | {r['started_to_gradient']} | {r['started']} ({r['started_ended']}) | "
                            f"{', '.join(map(percent, r['apart']))} |")
    for name, kinds in results.get("smooth", {}).items():
        text += ["", f"| {name} | iterations | median | largest | largest after `project` |", "|---|---|---|---|---|"]
        for title, series in kinds.items():
            raw, projected = np.array(series["raw"]), np.array(series["projected"])
            text.append(f"| {title} | {series['iterations']:.0f} | {percent(np.median(raw))} | {percent(raw.max())} | {percent(projected.max())} |")
    for name, row in results.get("sweep", {}).items():
        jump = np.array(row["projected"])  # of frame k + 2 against frame k + 1
        text += ["", f"sweep, {name}: median step {np.median(jump):.2g}, largest {jump.max():.3g}; inverted in {np.count_nonzero(row['inverted_tets'])} frames; "
                 f"undecided in {np.count_nonzero(row['undecided_colliders'])}, enclosed in {np.count_nonzero(row['enclosed_colliders'])}; "
                 f"ended {({e: row['ended'].count(e) for e in set(row['ended'])})}; median {np.median(row['solve_milliseconds']):.2g}, most {max(row['solve_milliseconds']):.2g} ms",
                 "", "| to frame | y | step / the ball's | undecided, before | enclosed, before | ended, before |", "|---|---|---|---|---|---|"]
        for k in np.flatnonzero(jump > 2):
            pair = lambda figure: f"{row[figure][k + 1]:.0f}, {row[figure][k]:.0f}"
            text.append(f"| {k + 2} | {SWEEP * (0.5 - (k + 1) / len(jump)):.4f} | {jump[k]:.3g} | {pair('undecided_colliders')} | {pair('enclosed_colliders')} | "
                        f"{row['ended'][k + 1]}, {row['ended'][k]} |")
    if "scale" in results:
        text += ["", "| height | iterations | rest RMS, max | equilibrium RMS, max | loop RMS, max |", "|---|---|---|---|---|"]
        for height, r in results["scale"].items():
            text.append(f"| {height} | {r['iterations']} | " + " | ".join("%.1e, %.1e" % tuple(r[k]) for k in ("rest", "eq", "loop")) + " |")
    return "\n".join(text) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--knead", required=True)
    parser.add_argument("--out", required=True, type=pathlib.Path)
    parser.add_argument("--mesh", action="append", default=[], type=lambda text: pathlib.Path(text).resolve())
    parser.add_argument("--anderson", type=pathlib.Path, help="the program of docs/study/anderson.cpp")
    parser.add_argument("--only", choices=("distance", "anderson", "smooth", "depth", "scale", "sweep", "pictures"))
    arguments = parser.parse_args()
    study = Study(arguments.knead, arguments.out)
    arguments.out.mkdir(parents=True, exist_ok=True)
    kept = arguments.out / "results.json"
    results = json.loads(kept.read_text()) if kept.exists() else {}
    save = lambda: kept.write_text(json.dumps(results, indent=1))
    parts = {"pictures": study_pictures, "scale": study_scale, "depth": study_depth, "smooth": study_smooth, "sweep": study_sweep,
             "distance": lambda s: study_distance(s, arguments.mesh, results.setdefault("distance", {}), save)}
    if arguments.anderson:
        parts["anderson"] = lambda s: study_anderson(s, arguments.anderson.resolve())
    for name, part in parts.items():
        if arguments.only in (None, name):
            made = part(study)
            if made:
                results[name] = made
                save()
            print(name, "done", flush=True)
    if "distance" in results:
        plot_distance(results["distance"], arguments.out / "distance.png")
    if "smooth" in results:
        plot_smooth(results["smooth"], arguments.out / "smooth.png")
    if (arguments.out / "pictures_crush" / "loop.png").exists():
        plot_pictures(study, arguments.out / "pictures.png")
    (arguments.out / "tables.md").write_text(tables(results))
    print(tables(results))


if __name__ == "__main__":
    main()
