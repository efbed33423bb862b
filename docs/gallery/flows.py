"""Plots of flows with known answers, from what the tests print:

    cargo test --release --lib lattice::validation -- --nocapture --test-threads 1 > flows.txt
    python3 docs/gallery/flows.py flows.txt docs/gallery

writes poiseuille.svg (errors by height of the channel) and taylor-green.svg (energy by time, errors by side of the box).
"""

import math
import re
import sys
from pathlib import Path

COLORS = ["#1f6fb4", "#d9822b", "#3a9a4c"]


class Plot:
    """One panel: axes from pairs (value, label), points in value space."""

    def __init__(self, left, size, x, y, title, log):
        self.left, (self.width, self.height) = left, size
        self.xs, self.ys, self.log = x, y, log
        self.out = [f'<text x="{left + 48}" y="32" font-weight="bold">{title}</text>']
        for value, label in x:
            px = self.at(value, y[0][0])[0]
            self.out.append(f'<path d="M{px:.1f} {self.height - 48}V48" stroke="#ddd"/>'
                            f'<text x="{px:.1f}" y="{self.height - 30}" text-anchor="middle">{label}</text>')
        for value, label in y:
            py = self.at(x[0][0], value)[1]
            self.out.append(f'<path d="M{left + 48} {py:.1f}H{left + self.width - 16}" stroke="#ddd"/>'
                            f'<text x="{left + 42}" y="{py + 4:.1f}" text-anchor="end">{label}</text>')

    def at(self, x, y):
        def share(v, ticks, log):
            f = math.log if log else float
            low, high = f(ticks[0][0]), f(ticks[-1][0])
            return (f(v) - low) / (high - low)
        return (self.left + 48 + share(x, self.xs, self.log[0]) * (self.width - 64),
                self.height - 48 - share(y, self.ys, self.log[1]) * (self.height - 96))

    def line(self, points, color, dash=""):
        path = " ".join("{:.1f},{:.1f}".format(*self.at(*p)) for p in points)
        extra = f' stroke-dasharray="{dash}"' if dash else ""
        self.out.append(f'<polyline fill="none" stroke="{color}" stroke-width="2"{extra} points="{path}"/>')

    def marks(self, points, color):
        for p in points:
            x, y = self.at(*p)
            self.out.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="none" stroke="{color}" stroke-width="1.5"/>')

    def legend(self, rows, at):
        for i, (text, color) in enumerate(rows):
            self.out.append(f'<text x="{self.left + at[0]}" y="{at[1] + 18 * i}" fill="{color}">{text}</text>')

    def below(self, text):
        self.out.append(f'<text x="{self.left + self.width / 2 + 16}" y="{self.height - 10}" text-anchor="middle">{text}</text>')


def svg(path, width, height, plots):
    head = (f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
            f'font-family="sans-serif" font-size="13">\n<rect width="{width}" height="{height}" fill="#fff"/>\n')
    path.write_text(head + "\n".join(line for p in plots for line in p.out) + "\n</svg>\n")


def decades(low, high):
    return [(10.0 ** k, f"1e{k}") for k in range(low, high + 1)]


def second_order(plot, n, first):
    """A line that falls with the square of the number of cells."""
    plot.line([(m, first * (n[0] / m) ** 2) for m in (n[0], n[-1])], "#888", "5 4")


def main(text, folder):
    number = r"([-+.\de]+)"
    heights = [8, 16, 32]
    plot = Plot(0, (480, 400), [(h, h) for h in heights], decades(-4, -1), "Poiseuille: error of the velocity", (True, True))
    rows = re.findall(rf"poiseuille tau {number}: {number} {number} {number},", text)
    for color, (tau, *errors) in zip(COLORS, rows):
        points = list(zip(heights, map(float, errors)))
        plot.line(points, color)
        plot.marks(points, color)
    second_order(plot, heights, 0.045)
    plot.legend([(f"tau {tau}", c) for c, (tau, *_) in zip(COLORS, rows)] + [("second order", "#888")], (70, 270))
    plot.below("cells between the walls")
    svg(folder / "poiseuille.svg", 480, 400, [plot])

    sides = [16, 32, 64]
    share = [(v / 10, f"{v / 10:g}") for v in range(4, 11, 2)]
    left = Plot(0, (440, 400), [(v / 4, f"{v / 4:g}") for v in range(5)], share, "Taylor-Green: energy over its first", (False, False))
    left.line([(t / 50, 0.5 ** (t / 50)) for t in range(51)], "#888")
    for color, n in zip(COLORS, sides):
        found = re.findall(rf"decay N {n} ours true: {number} {number} {number}", text)
        left.marks([(float(t), float(e)) for t, e, _ in found], color)
    left.legend([(f"{n} cells", c) for c, n in zip(COLORS, sides)] + [("exp(-4 nu k² t)", "#888")], (70, 260))
    left.below("time over that in which half is gone")
    right = Plot(440, (440, 400), [(n, n) for n in sides], decades(-4, -1), "errors at the end", (True, True))
    found = re.findall(rf"taylor-green N (\d+) ours true: nu {number}, velocity {number}", text)
    for color, column in zip(COLORS, (1, 2)):
        points = [(int(f[0]), float(f[column])) for f in found]
        right.line(points, color)
        right.marks(points, color)
    second_order(right, sides, 8e-3)
    right.legend([("viscosity", COLORS[0]), ("velocity", COLORS[1]), ("second order", "#888")], (70, 290))
    right.below("cells along a side")
    svg(folder / "taylor-green.svg", 880, 400, [left, right])


if __name__ == "__main__":
    main(Path(sys.argv[1]).read_text(), Path(sys.argv[2]))
