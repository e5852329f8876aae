"""Our engine and PyTorch in turns on one pair: time of each part, and our memory. Called by run.sh.

bench.py ENGINE_BENCH FOLDER ROUNDS THREADS [A B]    (A, B: square pictures; noise without them)
"""

import json
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import torch
from network import PATCH, Network
from safetensors.torch import load_file, save_file
from torch.utils.flop_counter import FlopCounterMode

PARTS = ["encoder", "decoders", "heads", "total"]
SIZES = [(384, 512), (512, 512)]


class Engine:
    """engine_bench, and the most memory of its own that it was seen to hold."""

    def __init__(self, program, weights, threads):
        self.process = subprocess.Popen(
            [program, weights], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env={"RAYON_NUM_THREADS": str(threads)}
        )
        self.anonymous_gb = 0.0
        threading.Thread(target=self.watch, daemon=True).start()
        self.greeting = json.loads(self.process.stdout.readline())

    def watch(self):
        status = Path(f"/proc/{self.process.pid}/status")
        while self.process.poll() is None:
            # A process that ends has no such line.
            kib = [int(line.split()[1]) for line in status.read_text().splitlines() if line.startswith("RssAnon")]
            self.anonymous_gb = max(self.anonymous_gb, *(k * 1024 / 1e9 for k in kib), 0.0)
            time.sleep(0.02)

    def ask(self, *words):
        self.process.stdin.write(" ".join(map(str, words)) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())


class Stopwatch:
    """Seconds by the wall and of the processor since the last look."""

    def __init__(self):
        self.last = self.now()

    @staticmethod
    def now():
        return np.array([time.perf_counter(), time.process_time()])

    def lap(self):
        before, self.last = self.last, self.now()
        return self.last - before


def torch_pair(network, images):
    """Times of the parts, and the outputs as our engine writes them."""
    height, width = (side // PATCH for side in images.shape[2:])
    watch, times = Stopwatch(), {}
    encoded = network.encode(images)
    times["encoder"] = watch.lap()
    hooks = network.decode(*encoded.split(1), height, width)
    times["decoders"] = watch.lap()
    outputs = network.heads(hooks, height, width)
    times["heads"] = watch.lap()
    times["total"] = sum(times.values())
    return times, outputs


def torch_symmetric(network, images):
    height, width = (side // PATCH for side in images.shape[2:])
    watch = Stopwatch()
    encoded = network.encode(images)
    for way in (encoded, encoded.flip(0)):
        network.heads(network.decode(*way.split(1), height, width), height, width)
    return watch.lap()


def torch_gemm():
    """GFLOP/s of the encoder's largest product."""
    a, b = torch.rand(2048, 1024), torch.rand(4096, 1024)
    best = np.full(2, np.inf)
    for _ in range(3):
        watch = Stopwatch()
        for _ in range(6):
            torch.nn.functional.linear(a, b)
        best = np.minimum(best, watch.lap())
    return 6 * 2 * 2048 * 1024 * 4096 / 1e9 / best


def gflop(height_px, width_px):
    """Of each part, as PyTorch counts its own operations."""
    with torch.device("meta"):
        network, counts = Network(), []
        height, width = height_px // PATCH, width_px // PATCH
        result = torch.empty(2, 3, height_px, width_px)
        for part in (network.encode, lambda x: network.decode(*x.split(1), height, width), lambda x: network.heads(x, height, width)):
            with FlopCounterMode(display=False) as counter:
                result = part(result)
            counts.append(counter.get_total_flops() / 1e9)
    return dict(zip(PARTS, [*counts, sum(counts)]))


def pictures(paths, height, width):
    """[2, 3, height, width] from −1 to 1; of a square picture the middle rows."""
    if not paths:
        return torch.rand(2, 3, height, width, generator=torch.Generator().manual_seed(1)) * 2 - 1
    from PIL import Image

    both = np.stack([np.asarray(Image.open(path).convert("RGB")) for path in paths])
    top = (both.shape[1] - height) // 2
    return torch.from_numpy(both[:, top : top + height, :width]).permute(0, 3, 1, 2).contiguous() / 127.5 - 1


def compare(outputs, path):
    """Largest difference of each map, relative to the map's largest value."""
    ours, at = torch.from_numpy(np.fromfile(path, np.float32)), 0
    worst = 0.0
    for value in (value for view in outputs for value in view):
        mine = ours[at : at + value.numel()].view(value.shape)
        at += value.numel()
        worst = max(worst, ((mine - value).abs().max() / value.abs().max()).item())
    assert at == len(ours)
    return worst


def median(values):
    """Of pairs of seconds: wall, processor."""
    return [statistics.median(value[idx] for value in values) for idx in (0, 1)]


def line(name, ours, theirs, work, peak):
    (wall, cpu), (their_wall, their_cpu) = ours, theirs
    share = f"{work:6.0f} GFLOP  {100 * work / wall / peak:3.0f} % of the peak" if work else ""
    print(
        f"  {name:10} ours {wall:6.2f} s ({cpu:6.2f})  PyTorch {their_wall:6.2f} s ({their_cpu:6.2f})  "
        f"ratio {wall / their_wall:.2f} ({cpu / their_cpu:.2f})  {share}"
    )


def measure(engine, network, size, rounds, paths, folder):
    height, width = size
    images = pictures(paths, height, width)
    raw, out = folder / "images.f32", folder / "outputs.f32"
    images.numpy().tofile(raw)
    ours, theirs, symmetric, peaks = [], [], [], []
    for number in range(rounds + 1):
        own = engine.ask("pair", height, width, raw, out)
        their, outputs = torch_pair(network, images)
        if number == 0:
            # The first of each warms it up.
            print(f"{width}x{height}: outputs differ by {compare(outputs, out):.1e} of their largest value")
            matching = engine.ask("match")
            continue
        ours.append(own)
        theirs.append(their)
        peaks.append(max(engine.ask("gemm")[0], torch_gemm()[0]))
        if number % 2 == 1:
            symmetric.append((engine.ask("symmetric"), torch_symmetric(network, images)))
    peak, work = statistics.median(peaks), gflop(height, width)
    print(f"  medians of {rounds}; wall seconds, in brackets the processor's; peak {peak:.0f} GFLOP/s")
    for part in PARTS:
        line(part, median([o[part] for o in ours]), median([t[part] for t in theirs]), work[part], peak)
    rest = [median([np.array(r["decoders"]) + r["heads"] for r in side]) for side in (ours, theirs)]
    line("cached", *rest, work["decoders"] + work["heads"], peak)
    line("symmetric", *(median(side) for side in zip(*symmetric)), 2 * work["total"] - work["encoder"], peak)
    return matching


def main():
    program, folder, rounds, threads = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
    torch.set_num_threads(threads)
    torch.manual_seed(0)
    weights = folder / "random.safetensors"
    network = Network()
    if not weights.exists():
        save_file(network.state_dict(), weights)
    network.load_state_dict(load_file(weights))
    # Its convolutions' faster way.
    network.to(memory_format=torch.channels_last)
    engine = Engine(program, weights, threads)
    print(f"PyTorch {torch.__version__}, ours with {engine.greeting['simd']}; {threads} threads each; parameters:", end=" ")
    print(f"{sum(p.numel() for p in network.parameters())}; packed in {engine.greeting['packed'][0]:.1f} s")
    with torch.inference_mode():
        for size in SIZES:
            matching = measure(engine, network, size, rounds, sys.argv[5:], folder)
    print(f"our anonymous memory, loading and both sizes: {engine.anonymous_gb:.2f} GB at most")
    print("matching 512x512, best of three:")
    made_up = json.loads(subprocess.check_output([program], env={"RAYON_NUM_THREADS": str(threads)}))
    for name, result in {"the network's": matching, **made_up}.items():
        print(f"  {name:14} {result['matches']:5} matches  {result['wall_s']:.3f} s ({result['cpu_s']:.2f})")


if __name__ == "__main__":
    main()
