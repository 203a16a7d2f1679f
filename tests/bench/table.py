#!/usr/bin/env python3
"""Prints the figures of loop_bench's JSON as Markdown tables. Every time is the best repetition's; every share is of the same run."""
import json
import math
import sys


def load(path):
    with open(path) as file:
        data = json.load(file)
    best = {}
    seconds = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1}
    for run in data["benchmarks"]:
        if run.get("run_type") == "aggregate" or run.get("error_occurred"):
            continue
        time = run["real_time"] * seconds[run["time_unit"]]
        name = run["name"].split("/repeats:")[0]
        if name not in best or time < best[name]["time"]:
            best[name] = dict(run, time=time)
    return data["context"], best


def show_time(seconds):
    return f"{seconds * 1e6:.0f} us" if seconds < 1e-3 else f"{seconds * 1e3:.2f} ms" if seconds < 0.1 else f"{seconds:.2f} s"


def table(header, rows):
    if not rows:
        return
    print("| " + " | ".join(header) + " |")
    print("|" + "---|" * len(header))
    for row in rows:
        print("| " + " | ".join(row) + " |")
    print()


class Machine:
    def __init__(self, best):
        self.copies, self.peak = {}, {}
        for name, run in best.items():
            parts = name.split("/")
            if parts[0] == "copy":
                self.copies.setdefault(parts[2], []).append((run["bytes"], run["bytes"] / run["time"]))
            if parts[0] == "multiply_and_add":
                self.peak[parts[1]] = run["flops"] / run["time"]

    def copy(self, bytes_moved, threads):
        """Speed of a copy that moves about as many bytes: caches serve both alike."""
        of = self.copies.get(threads)
        return min(of, key=lambda at: abs(math.log(at[0] / bytes_moved)))[1] if of else None


def kernels(best, machine):
    rows, before = [], {}
    for name, run in sorted(best.items(), key=lambda item: item[1].get("tets", 0)):
        kind, kernel, *rest = name.split("/")
        if kind != "kernel":
            continue
        size, threads = rest
        speed = run["bytes"] / run["time"]
        copy, peak = machine.copy(run["bytes"], threads), machine.peak.get(threads)
        plain = best.get(f"plain/{kernel}/{size}")
        last = before.get((kernel, threads))
        before[kernel, threads] = run
        rows.append([kernel, f"{run['tets']:,.0f}", threads.split(":")[1], show_time(run["time"]), f"{run['bytes'] / 1e6:.2f}", f"{speed / 1e9:.1f}",
                     f"{100 * speed / copy:.0f} %" if copy else "-",
                     f"{run['flops'] / run['time'] / 1e9:.1f}" if "flops" in run else "-",
                     f"{100 * run['flops'] / run['time'] / peak:.0f} %" if "flops" in run and peak else "-",
                     f"{math.log(run['time'] / last['time']) / math.log(run['tets'] / last['tets']):.2f}" if last else "-",
                     f"{plain['time'] / run['time']:.1f}" if plain else "-"])
    rows.sort(key=lambda row: (row[0], row[2], int(row[1].replace(",", ""))))
    table(["kernel", "tets", "threads", "time", "MB to move", "GB/s", "of copy", "Gflop/s", "of peak", "exponent", "times plain"], rows)


def structures(best):
    """Times over the jagged table's, a column for each size."""
    found = {}
    for name, run in best.items():
        if name.startswith("structure/"):
            _, kernel, layout, size, threads = name.split("/")
            found.setdefault((kernel, threads), {}).setdefault(size, {})[layout] = run
    layouts = ["jagged", "sliced_by_valence", "sliced_in_windows", "ell", "csr", "jagged_one_lane"]
    for (kernel, threads), sizes in sorted(found.items()):
        columns = sorted(sizes.values(), key=lambda runs: next(iter(runs.values()))["tets"])
        rows = []
        for layout in layouts:
            cells = []
            for runs in columns:
                run, jagged = runs.get(layout), runs.get("jagged")
                cells.append(f"{run['time'] / jagged['time']:.2f} ({show_time(run['time'])})" if run and jagged else "-")
            rows.append([layout.replace("_", " ")] + cells)
        table([f"{kernel}, {threads.replace(':', ' ')}"] + [f"{next(iter(runs.values()))['tets']:,.0f} tets" for runs in columns], rows)


def frames(best):
    rows = []
    for name, run in sorted(best.items()):
        if not name.startswith("frames/"):
            continue
        _, example, threads = name.split("/")
        plain = best.get(f"plain/frames/{example}")
        each = run["time"] / run["frames"]
        rows.append([example, threads.split(":")[1], show_time(each), f"{1 / each:.1f}", f"{plain['time'] / each:.1f}" if plain else "-"])
        if plain and threads == "threads:1":
            rows.append([example + ", plain reference", "1", show_time(plain["time"]), f"{1 / plain['time']:.2f}", "1"])
    table(["frames of", "threads", "time a frame", "frames/s", "times plain"], rows)


def memory(best):
    rows = []
    for name, run in sorted(best.items(), key=lambda item: item[1].get("tets", 0)):
        if not name.startswith("memory/"):
            continue
        loop = run["bytes_of_h"] + run["bytes_of_maps"] + run["bytes_moving"]
        rows.append([f"{run['tets']:,.0f}", f"{run['vertices']:,.0f}", f"{run['bytes_of_h'] / run['tets']:.0f}", f"{run['bytes_of_h'] / run['vertices']:.0f}",
                     f"{loop / run['tets']:.0f}", f"{loop / run['vertices']:.0f}", f"{run['bytes_kept'] / run['tets']:.0f}"])
    table(["tets", "vertices of H", "H in the loop, bytes/tet", "bytes/vertex", "whole loop, bytes/tet", "bytes/vertex", "kept, bytes/tet"], rows)


def main():
    if len(sys.argv) != 2:
        sys.exit("usage: table.py FILE.json")
    context, best = load(sys.argv[1])
    machine = Machine(best)
    print(f"{context['processor']}, {context['num_cpus']} cores, {context['simd']}, device {context['device']}, {context['date'][:10]}, commit "
          f"{context.get('commit', 'unknown')}: `{context.get('command', '')}`. Load average at the start: {context['load_avg'][0]:.2f}.\n")
    rows = [[f"{size / 1e6:.1f} MB", threads.split(":")[1], f"{speed / 1e9:.1f}"] for threads, sizes in sorted(machine.copies.items()) for size, speed in sorted(sizes)]
    table(["copy, bytes moved", "threads", "GB/s read and written"], rows)
    table(["threads", "peak Gflop/s, multiply-add"], [[threads.split(":")[1], f"{speed / 1e9:.0f}"] for threads, speed in sorted(machine.peak.items())])
    kernels(best, machine)
    structures(best)
    frames(best)
    memory(best)


if __name__ == "__main__":
    main()
