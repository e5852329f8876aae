#!/usr/bin/env python3
"""Writes a checkpoint of random weights in the layout of the published one, for measuring and for tests by hand.

    python3 full_checkpoint.py full_shapes.json full.pth

`full_shapes.json` maps each name of the state dict to its shape. With PyTorch installed `torch.save` writes the file;
without it the same bytes are laid out by hand (protocol 2 pickle, stored entries), so that no
download of several gigabytes is needed. `scratch.layer_rn.N` shares its storage with `scratch.layer{N+1}_rn`.
"""
import argparse
import collections
import json
import pickle
import random
import sys
import zipfile

MODEL = (
    "AsymmetricMASt3R(pos_embed='RoPE100', patch_embed_cls='ManyAR_PatchEmbed', img_size=(512, 512), "
    "head_type='catmlp+dpt', output_mode='pts3d+desc24', depth_mode=('exp', -inf, inf), conf_mode=('exp', 1, inf), "
    "enc_embed_dim=1024, enc_depth=24, enc_num_heads=16, dec_embed_dim=768, dec_depth=12, dec_num_heads=12, "
    "two_confs=True, desc_conf_mode=('exp', 0, inf))"
)


def owner(name):
    """The name that owns an alias's storage."""
    head, mark, rest = name.partition(".scratch.layer_rn.")
    if not mark:
        return name
    number, _, tail = rest.partition(".")
    return f"{head}.scratch.layer{int(number) + 1}_rn.{tail}"


def with_torch(torch, shapes, out):
    tensors = {name: torch.randn(shape) * 0.02 for name, shape in shapes.items() if owner(name) == name}
    state = collections.OrderedDict((name, tensors[owner(name)]) for name in shapes)
    torch.save({"args": argparse.Namespace(model=MODEL, seed=0), "model": state}, out)


class Storage:
    def __init__(self, key, length):
        self.key, self.length = key, length


def by_hand(shapes, out):
    # Classes of the names that PyTorch's pickles call: the pickler looks them up and writes their names only.
    modules = {}
    for module, name in [("torch._utils", "_rebuild_tensor_v2"), ("torch", "FloatStorage")]:
        modules.setdefault(module, type(sys)(module))
        stand_in = type(name, (), {"__module__": module})
        stand_in.__qualname__ = name
        setattr(modules[module], name, stand_in)
    sys.modules.update(modules)
    rebuild, float_storage = modules["torch._utils"]._rebuild_tensor_v2, modules["torch"].FloatStorage

    class Tensor:
        def __init__(self, storage, shape):
            self.storage, self.shape = storage, shape

        def __reduce__(self):
            strides = [1] * len(self.shape)
            for side in reversed(range(len(self.shape) - 1)):
                strides[side] = strides[side + 1] * self.shape[side + 1]
            hooks = collections.OrderedDict()
            return rebuild, (self.storage, 0, tuple(self.shape), tuple(strides), False, hooks)

    class Pickler(pickle._Pickler):
        def persistent_id(self, thing):
            if isinstance(thing, Storage):
                return ("storage", float_storage, thing.key, "cpu", thing.length)
            return None

        def save_global(self, thing, name=None):
            super().save_global(thing, name or getattr(thing, "__qualname__", None))

    storages, state = {}, collections.OrderedDict()
    for name, shape in shapes.items():
        if owner(name) not in storages:
            length = 1
            for side in shape:
                length *= side
            storages[owner(name)] = Storage(str(len(storages)), length)
        state[name] = Tensor(storages[owner(name)], shape)
    state._metadata = collections.OrderedDict({"": {"version": 1}})
    block = bytes(byte if i % 4 < 3 else 0x3C for i, byte in enumerate(random.Random(0).randbytes(1 << 20)))
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive, open(out + ".pkl", "wb+") as text:
        Pickler(text, protocol=2).dump({"args": argparse.Namespace(model=MODEL, seed=0), "model": state})
        text.seek(0)
        archive.writestr("archive/data.pkl", text.read())
        archive.writestr("archive/byteorder", "little")
        for storage in storages.values():
            # Values around 0.01: the low bytes are noise, the high one is an exponent.
            with archive.open(f"archive/data/{storage.key}", "w", force_zip64=True) as entry:
                left = storage.length * 4
                while left:
                    entry.write(block[: min(left, len(block))])
                    left -= min(left, len(block))
        archive.writestr("archive/version", "3\n")


def main():
    shapes = json.load(open(sys.argv[1]))
    try:
        import torch
    except ImportError:
        by_hand(shapes, sys.argv[2])
        print("written by hand, without PyTorch")
    else:
        with_torch(torch, shapes, sys.argv[2])
        print("written by PyTorch", torch.__version__)


if __name__ == "__main__":
    main()
