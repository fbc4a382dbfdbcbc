"""Compares the time of one pass of the pose networks with TFLite (XNNPACK), one thread each, in alternating runs.

pip install ai-edge-litert numpy
cargo build --release -p pirouette-pose --example time_passes
python benches/peers/pose.py MODELS [ROUNDS]

MODELS is a folder with pose_landmark_{lite,full,heavy}.tflite. Prints a Markdown table: the median processor time of a pass
of each, and the median of the ratios of neighboring runs. TFLite always computes the mask. Needs Linux, whose scheduler
reports processor times in nanoseconds: times on a clock include other programs.
"""

import os
import statistics
import subprocess
import sys
from pathlib import Path

import numpy as np
from ai_edge_litert.interpreter import Interpreter

TARGET = Path(os.environ.get("CARGO_TARGET_DIR", "target"))
PASSES = {"lite": 8, "full": 5, "heavy": 2}


def processor_ms(process):
    """Processor time of the main thread of a process so far"""
    return int(Path(f"/proc/{process}/schedstat").read_text().split()[0]) / 1e6


def main():
    models, rounds = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 40
    # Both on the same core: the other may be slowed down by other programs.
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print("| network | TFLite, ms | ours with mask, ms | ratio | ours without mask, ms | ratio |")
    print("|---|---:|---:|---:|---:|---:|")
    for network, passes in PASSES.items():
        model = models / f"pose_landmark_{network}.tflite"
        theirs = Interpreter(model_path=str(model), num_threads=1)
        theirs.allocate_tensors()
        index = theirs.get_input_details()[0]["index"]
        theirs.set_tensor(index, np.random.default_rng(1).random((1, 256, 256, 3), np.float32))

        ours = subprocess.Popen(
            [TARGET / "release/examples/time_passes", model],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )

        def our_ms(what):
            start = processor_ms(ours.pid)
            print(what, passes, file=ours.stdin, flush=True)
            ours.stdout.readline()
            return (processor_ms(ours.pid) - start) / passes

        def their_ms():
            start = processor_ms("self")
            for _ in range(passes):
                theirs.invoke()
            return (processor_ms("self") - start) / passes

        for _ in range(3):
            their_ms(), our_ms("mask"), our_ms("landmarks")
        runs = [(their_ms(), our_ms("mask"), our_ms("landmarks")) for _ in range(rounds)]
        ours.stdin.close()
        ours.wait()
        typical = [statistics.median(run[k] for run in runs) for k in range(3)]
        ratio = [statistics.median(run[k] / run[0] for run in runs) for k in (1, 2)]
        print(f"| {network} | {typical[0]:.1f} | {typical[1]:.1f} | {ratio[0]:.2f} | {typical[2]:.1f} | {ratio[1]:.2f} |", flush=True)


main()
