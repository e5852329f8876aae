#!/usr/bin/env python3
"""Writes a checkpoint of random weights in the layout of the published one, and compares one with what we made of it.

    python3 full_checkpoint.py full_shapes.json full.pth [--dtype bf16] [--training]
    selenograph weights convert full.pth --out full.safetensors
    python3 full_checkpoint.py full_shapes.json full.pth --compare full.safetensors

Needs PyTorch and safetensors. `full_shapes.json` maps each name of the state dict to its shape. `scratch.layer_rn.N`
shares its storage with `scratch.layer{N+1}_rn`. `--training` adds what a training run keeps beside the weights.
"""
import argparse
import collections
import json

import torch
from safetensors import safe_open

MODEL = (
    "AsymmetricMASt3R(pos_embed='RoPE100', patch_embed_cls='ManyAR_PatchEmbed', img_size=(512, 512), "
    "head_type='catmlp+dpt', output_mode='pts3d+desc24', depth_mode=('exp', -inf, inf), conf_mode=('exp', 1, inf), "
    "enc_embed_dim=1024, enc_depth=24, enc_num_heads=16, dec_embed_dim=768, dec_depth=12, dec_num_heads=12, "
    "two_confs=True, desc_conf_mode=('exp', 0, inf))"
)
DTYPES = {"f32": torch.float32, "f16": torch.float16, "bf16": torch.bfloat16}


def owner(name):
    """The name that owns an alias's storage."""
    head, mark, rest = name.partition(".scratch.layer_rn.")
    if not mark:
        return name
    number, _, tail = rest.partition(".")
    return f"{head}.scratch.layer{int(number) + 1}_rn.{tail}"


def write(shapes, path, dtype, training):
    generator = torch.Generator().manual_seed(0)
    tensors = {}
    for name, shape in shapes.items():
        if owner(name) == name:
            tensors[name] = (torch.randn(shape, generator=generator) * 0.02).to(dtype)
    state = collections.OrderedDict((name, tensors[owner(name)]) for name in shapes)
    state._metadata = collections.OrderedDict({"": {"version": 1}})
    args = argparse.Namespace(model=MODEL, lr=1e-4, epochs=25, resume=None, amp=1, disable_cudnn_benchmark=False)
    checkpoint = {"args": args, "model": state}
    if training:
        # Two of the tensors are enough: what an optimiser keeps is never read.
        parts = [torch.nn.Parameter(tensors[name].float()) for name in ("enc_norm.weight", "dec_norm.weight")]
        optimizer = torch.optim.AdamW(parts, betas=(0.9, 0.95))
        sum(part.sum() for part in parts).backward()
        optimizer.step()
        scaler = {"scale": 65536.0, "growth_factor": 2.0, "backoff_factor": 0.5, "growth_interval": 2000, "_growth_tracker": 7}
        checkpoint |= {"optimizer": optimizer.state_dict(), "scaler": scaler, "epoch": 12, "best_so_far": 0.5}
    torch.save(checkpoint, path)


def compare(shapes, path, converted):
    state = torch.load(path, weights_only=False, mmap=True)["model"]
    unique = parameters = 0
    with safe_open(converted, "pt") as file:
        names = set(file.keys())
        assert names <= set(state), sorted(names - set(state))
        assert {owner(name) for name in state} == {owner(name) for name in names}
        for name in names:
            tensor, stored = file.get_tensor(name), state[name]
            # Safetensors of ours have no f16.
            expected = stored.float() if stored.dtype == torch.float16 else stored
            assert list(tensor.shape) == shapes[name] and tensor.dtype == expected.dtype, name
            assert torch.equal(tensor.view(torch.uint8), expected.view(torch.uint8)), name
            unique += 1
            parameters += tensor.numel()
    print(f"{unique} tensors, {parameters} parameters: names, shapes, types and bytes are the same")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shapes")
    parser.add_argument("file")
    parser.add_argument("--dtype", choices=DTYPES, default="f32")
    parser.add_argument("--training", action="store_true")
    parser.add_argument("--compare", metavar="CONVERTED")
    options = parser.parse_args()
    shapes = json.load(open(options.shapes))
    if options.compare:
        compare(shapes, options.file, options.compare)
    else:
        write(shapes, options.file, DTYPES[options.dtype], options.training)


if __name__ == "__main__":
    main()
