#!/usr/bin/env python3
"""Draws time and error as SVG from what `stipple-bench --json` wrote, with gnuplot (5.4 or newer).

    plot.py FOLDER results.json...

Cases `by-target/...` give time and error against the points that are left, `by-size/...` time against the
points there were, as Figure 9 of the paper does. Texts and axes are grey, to be read on white and on black.
"""

import json
import statistics
import subprocess
import sys
from pathlib import Path

# Contestant, name in the key, colour (Okabe and Ito's, told apart by the colour-blind too), point type.
LINES = [
    ("stipple multiphase", "multiphase", "#2a86c8", 7),
    ("stipple hierarchical", "hierarchical", "#56b4e9", 5),
    ("stipple incremental", "incremental", "#009e73", 9),
    ("stipple iterative", "iterative", "#d55e00", 11),
    ("stipple particles", "particles", "#cc79a7", 13),
    ("stipple voxel", "voxel", "#e69f00", 4),
    ("CGAL hierarchy", "CGAL hierarchy", "#808080", 6),
]

STYLE = """
set terminal svg size {width},440 fixed font 'DejaVu Sans,13' linewidth 1.6
set output '{output}'
set border 3 lc rgb '#808080' lw 0.8
set tics nomirror textcolor rgb '#808080' scale 0.6
set grid lc rgb '#808080' lw 0.25
set key outside right center textcolor rgb '#808080' samplen 2.2 spacing 1.25
set logscale xy
set format x '%.0s%c'
set xlabel '{xlabel}' textcolor rgb '#808080'
"""


def read(cases, kind):
    """{contestant: [(x, processor seconds, figures)]} of the one-thread cases of a kind, by points left or before."""
    lines = {}
    for case in cases:
        parts = case["case"].split("/")
        if parts[0] != kind or case["threads"] != 1:
            continue
        x = case["units"] if kind == "by-size" else int(parts[-1])
        for standing in case["standings"]:
            seconds = statistics.median(run["cpu_s"] for run in standing["runs"])
            lines.setdefault(standing["contestant"], []).append((x, seconds, standing["figures"]))
    return {name: sorted(points, key=lambda point: point[0]) for name, points in lines.items()}


def left_of(cases, kind):
    """The title of the axis of targets, with what was there before."""
    work = next(case["work"] for case in cases if case["case"].startswith(kind))
    model, points = work.split(" points")[0].split(": ")
    return f"points left of {points} ({model})"


def curves(lines, y):
    """gnuplot's data blocks, and the plot command that shows them."""
    blocks, parts = [], []
    for i, (name, title, colour, point) in enumerate(LINES):
        if name not in lines:
            continue
        rows = "\n".join(f"{x} {y(seconds, figures)}" for x, seconds, figures in lines[name])
        blocks.append(f"$line{i} << EOD\n{rows}\nEOD")
        dashes = " dt (6,4)" if name.startswith("CGAL") else ""
        parts.append(f"$line{i} using 1:2 with linespoints lc rgb '{colour}' pt {point} ps 0.55{dashes} title '{title}'")
    return "\n".join(blocks), "plot " + ", \\\n     ".join(parts)


def around(axis, values):
    return f"set {axis}range [{min(values) / 1.25}:{max(values) * 1.25}]\n"


def labels_between(values):
    """2 and 5 beside 1, where there are few of those."""
    if max(values) > 200 * min(values):
        return ""
    return "set ytics add (" + ", ".join(f"'{m * 10 ** e:g}' {m * 10 ** e:g}" for e in range(-3, 5) for m in (2, 5)) + ")\n"


def draw(output, xlabel, panels, width=760):
    """One SVG with a panel for each (title of the y axis, lines, y)."""
    script = STYLE.format(width=width, output=output, xlabel=xlabel)
    if len(panels) > 1:
        script += f"set multiplot layout 1,{len(panels)}\n"
    for i, (ylabel, lines, y) in enumerate(panels):
        blocks, plot = curves(lines, y)
        if i + 1 < len(panels):
            plot = "unset key\n" + plot + "\nset key outside right center"
        script += f"set ylabel '{ylabel}' textcolor rgb '#808080'\n"
        script += around("x", [x for points in lines.values() for x, _, _ in points])
        values = [y(s, f) for points in lines.values() for _, s, f in points]
        script += around("y", values) + labels_between(values)
        script += f"{blocks}\n{plot}\n"
    subprocess.run(["gnuplot"], input=script, text=True, check=True)


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    folder = Path(sys.argv[1])
    results = [case for file in sys.argv[2:] for case in json.load(open(file))]
    milliseconds = lambda seconds, figures: 1e3 * seconds
    by_target, by_size = read(results, "by-target"), read(results, "by-size")
    if by_target:
        draw(folder / "time-by-target.svg", left_of(results, "by-target"),
             [("milliseconds of one processor", by_target, milliseconds)])
        if all("Δavg" in point[2] for points in by_target.values() for point in points):
            draw(folder / "error-by-target.svg", left_of(results, "by-target"),
                 [("mean error Δ_{avg}, 10^{-4} of the diagonal", by_target, lambda s, f: f["Δavg"]),
                  ("largest error Δ_{max}", by_target, lambda s, f: f["Δmax"])], width=1180)
    if by_size:
        draw(folder / "time-by-size.svg", "points before, simplified to 1 % (synthetic)",
             [("milliseconds of one processor", by_size, milliseconds)])


if __name__ == "__main__":
    main()
