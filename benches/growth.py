"""Scans rendered people with increasing size and number of photos, and prints time and memory as Markdown.

    cargo build --release -p pirouette-cli -p pirouette-bench
    python benches/growth.py [--quick]

Each scan runs in a separate process. The shortest wall time and its peak memory are printed, with ratios to the
previous row.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

BINARIES = Path(os.environ.get("BINARIES", "target/release"))
SIZES = [(400, 500), (800, 1000), (1600, 2000), (3100, 3872)]
VIEW_COUNTS = [4, 8, 16, 36, 72]
RUNS = 3


def scan(folder, *options):
    """Returns seconds and megabytes of the best run"""
    best = (float("inf"), 0.0)
    for _ in range(RUNS):
        command = [BINARIES / "pirouette", "scan", folder, "-o", folder / "result", "--json", *options]
        start = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        if status != 0:
            raise SystemExit(f"{' '.join(map(str, command))} failed")
        best = min(best, (seconds, usage.ru_maxrss / 1024))
    return best


def table(title, cases, options=()):
    print(f"| {title} | s | MB | work | time | memory |")
    print("|---|---:|---:|---:|---:|---:|")
    before = None
    for name, amount, (width, height, views) in cases:
        with tempfile.TemporaryDirectory() as folder:
            render = [BINARIES / "render-scan", folder, str(width), str(height), str(views)]
            subprocess.run(render, check=True)
            seconds, megabytes = scan(Path(folder), *options)
        ratios = ""
        if before:
            now = (amount, seconds, megabytes)
            ratios = " | ".join(f"x {a / b:.1f}" for a, b in zip(now, before))
        print(f"| {name} | {seconds:.2f} | {megabytes:.0f} | {ratios or ' | | '} |", flush=True)
        before = (amount, seconds, megabytes)
    print()


def main():
    quick = "--quick" in sys.argv
    sizes, counts = (SIZES[:2], VIEW_COUNTS[:2]) if quick else (SIZES, VIEW_COUNTS)
    by_size = [(f"{w} x {h}", w * h, (w, h, 8)) for w, h in sizes]
    table("photos, 8 views", by_size)
    table("views of 800 x 1000", [(str(n), n, (800, 1000, n)) for n in counts])
    table("8 views of 800 x 1000, `--method three-step`", [("8", 8, (800, 1000, 8))], ("--method", "three-step"))


if __name__ == "__main__":
    main()
