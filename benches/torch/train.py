"""Whole training steps of PyTorch with a frozen encoder, as `finetune_bench` makes them. Called by train.sh.

train.py make WEIGHTS              random weights by PyTorch's own initialisation
train.py run WEIGHTS BATCH STEPS   a line of JSON for each part of each step
train.py table OURS THEIRS         from the lines of several runs
"""

import json
import math
import os
import statistics
import sys
import time
from pathlib import Path

import torch
from network import PATCH, Network
from safetensors.torch import load_file, save_file
from torch.nn import functional as F

# Minus the logarithm of the smallest probability of a match.
LARGEST = 8 * math.log(10)
PARTS = ["encode", "forward", "loss", "backward", "optimizer"]


def memory_gb(key):
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(key))
    return int(line.split()[1]) * 1024 / 1e9


class Watch:
    """Seconds by the wall and of the processor since the last look, and the most memory since then."""

    def __init__(self):
        self.restart()

    def restart(self):
        Path("/proc/self/clear_refs").write_text("5")
        self.wall, self.cpu = time.perf_counter(), time.process_time()

    def lap(self, part):
        wall, cpu = time.perf_counter() - self.wall, time.process_time() - self.cpu
        peak = memory_gb("VmHWM")
        print(json.dumps({"part": part, "wall_s": wall, "cpu_s": cpu, "peak_gb": peak}), flush=True)
        self.restart()
        return peak


def scale(points):
    """Mean distance from camera A over both views: [batch, 1, 1, 1]."""
    lengths = [p.norm(dim=-1).flatten(1) for p in points]
    return torch.cat(lengths, 1).mean(1)[:, None, None, None]


def loss_of(outputs, batch):
    """Regression weighted by confidence, and InfoNCE weighted by its own; every pixel is known."""
    predicted, truth = [o[0] for o in outputs], batch["points"]
    own, true = scale(predicted), scale(truth)
    total = 0
    for (_, confidence, _, _), found, expected in zip(outputs, predicted, truth):
        distance = (found / own - expected / true).norm(dim=-1)
        total = total + (distance * confidence - 0.2 * confidence.log()).mean()
    losses, weights = [], []
    for item in range(len(truth[0])):
        pixels, valid = batch["pixels"][item], batch["valid"]
        a, b = (o[2][item].flatten(0, 1)[p] for o, p in zip(outputs, pixels))
        similarity = a @ b.T / 0.05
        matched = similarity.diagonal()
        each = sum((similarity.logsumexp(dim) - matched).clamp(max=LARGEST) for dim in (0, 1))
        confidence = sum(o[3][item].flatten()[p] for o, p in zip(outputs, pixels)) / 2
        losses.append(each[valid])
        weights.append(confidence[valid])
    each, confidence = torch.cat(losses), torch.cat(weights)
    return total + 0.075 * (each * confidence - 10 * confidence.log()).mean()


def read_batch(path):
    """The pair both ways: item 0 is (A, B), item 1 (B, A)."""
    arrays = load_file(path)
    a, b = (arrays[f"pixels_{view}"].long() for view in "ab")
    return {
        "images": arrays["images"],
        "points": [arrays["points_a"], arrays["points_b"]],
        "pixels": [(a, b), (b, a)],
        "valid": arrays["valid"].bool(),
    }


def run(weights, path, num_steps):
    torch.set_num_threads(int(os.environ.get("THREADS", "1")))
    with torch.device("meta"):
        network = Network()
    network.load_state_dict(load_file(weights), assign=True)
    network.to(memory_format=torch.channels_last)
    network.requires_grad_(True)
    for part in (network.patch_embed, network.enc_blocks):
        part.requires_grad_(False)
    network.mask_token.requires_grad_(False)
    learning = [p for p in network.parameters() if p.requires_grad]
    groups = [
        {"params": [p for p in learning if p.ndim > 1], "weight_decay": 0.05},
        {"params": [p for p in learning if p.ndim <= 1], "weight_decay": 0.0},
    ]
    optimizer = torch.optim.AdamW(groups, lr=3e-5, betas=(0.9, 0.95), fused=True)
    batch = read_batch(path)
    images = batch["images"]
    height, width = (side // PATCH for side in images.shape[2:])
    watch = Watch()
    for step in range(1, num_steps + 1):
        images[0, 0, 0, 0] = step / 256
        watch.restart()
        with torch.no_grad():
            features = network.encode_blocks(images)
        peaks = [watch.lap("encode")]
        encoded = network.enc_norm(features)
        outputs = network.heads(network.decode(encoded, encoded.flip(0), height, width), height, width)
        peaks.append(watch.lap("forward"))
        loss = loss_of(outputs, batch)
        del outputs, encoded
        peaks.append(watch.lap("loss"))
        loss.backward()
        peaks.append(watch.lap("backward"))
        optimizer.step()
        optimizer.zero_grad(set_to_none=True)
        peaks.append(watch.lap("optimizer"))
        print(json.dumps({"step": step, "loss": loss.item(), "peak_gb": max(peaks)}), flush=True)


def table(*paths):
    """Medians over the steps of all runs, and the losses, which must agree."""
    ours, theirs = ([json.loads(line) for line in Path(path).read_text().splitlines()] for path in paths)
    for side, lines in (("ours", ours), ("PyTorch", theirs)):
        print(side, "losses", [line["loss"] for line in lines if "loss" in line], end="; ")
        print(f"peak {max(line['peak_gb'] for line in lines if 'step' in line):.1f} GB")

    def median(lines, part, key):
        return statistics.median(line[key] for line in lines if line.get("part") == part)

    rows = [[(median(side, part, "cpu_s"), median(side, part, "wall_s")) for side in (ours, theirs)] for part in PARTS]
    rows.append([tuple(sum(row[side][idx] for row in rows) for idx in (0, 1)) for side in (0, 1)])
    print("seconds of the processor, in brackets by the wall")
    for part, ((own, own_wall), (their, their_wall)) in zip([*PARTS, "step"], rows):
        print(f"  {part:10} ours {own:7.2f} ({own_wall:7.2f})  PyTorch {their:7.2f} ({their_wall:7.2f})  ratio {own / their:.2f}")


def make(path):
    torch.manual_seed(0)
    save_file(Network().state_dict(), path)


if __name__ == "__main__":
    command, *args = sys.argv[1:]
    if command == "run":
        run(args[0], args[1], int(args[2]))
    else:
        {"make": make, "table": table}[command](*args)
