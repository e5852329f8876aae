"""The network of MASt3R as PyTorch modules, written from its shapes; fields are called as tensors of the checkpoint are."""

import torch
from torch import nn
from torch.nn import functional as F

PATCH = 16
ENCODER = {"dim": 1024, "blocks": 24, "heads": 16}
DECODER = {"dim": 768, "blocks": 12, "heads": 12}
LEVELS = [96, 192, 384, 768]
FUSION, LAST = 256, 128
CHANNELS = 25  # 24 of a descriptor, and its confidence


def positions(height, width, head_dim):
    """Cosines of a grid's tokens and sines with their signs: [tokens, 1, head_dim], of the row, then of the column."""
    powers = 100.0 ** (-torch.arange(head_dim // 4) * 4.0 / head_dim)
    rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    angles = torch.stack((rows.flatten(), columns.flatten()), -1)[:, None, :, None] * powers
    cos, sin = angles.cos(), angles.sin()
    return torch.stack((cos, cos), -2).flatten(-3), torch.stack((-sin, sin), -2).flatten(-3)


def rotate(x, angles):
    """[batch, tokens, heads, head_dim]: the fastest of six ways that were tried."""
    cos, sin = angles
    a, b, c, d = x.chunk(4, -1)
    return (x * cos).addcmul_(torch.cat((b, a, d, c), -1), sin)


def attend(q, k, v, heads, q_angles, k_angles):
    """[batch, tokens, dim] each, to the same."""
    q, k, v = (x.unflatten(-1, (heads, -1)) for x in (q, k, v))
    q, k, v = (x.transpose(1, 2) for x in (rotate(q, q_angles), rotate(k, k_angles), v))
    return F.scaled_dot_product_attention(q, k, v).transpose(1, 2).flatten(2)


def norm(dim):
    return nn.LayerNorm(dim, eps=1e-6)


class Attention(nn.Module):
    def __init__(self, dim, heads):
        super().__init__()
        self.heads = heads
        self.qkv = nn.Linear(dim, 3 * dim)
        self.proj = nn.Linear(dim, dim)

    def forward(self, x, angles):
        return self.proj(attend(*self.qkv(x).chunk(3, -1), self.heads, angles, angles))


class CrossAttention(nn.Module):
    def __init__(self, dim, heads):
        super().__init__()
        self.heads = heads
        self.projq, self.projk, self.projv, self.proj = (nn.Linear(dim, dim) for _ in range(4))

    def forward(self, x, y, x_angles, y_angles):
        out = attend(self.projq(x), self.projk(y), self.projv(y), self.heads, x_angles, y_angles)
        return self.proj(out)


class Mlp(nn.Module):
    def __init__(self, dim, hidden, out):
        super().__init__()
        self.fc1 = nn.Linear(dim, hidden)
        self.fc2 = nn.Linear(hidden, out)

    def forward(self, x):
        return self.fc2(F.gelu(self.fc1(x)))


class EncoderBlock(nn.Module):
    def __init__(self, dim, heads):
        super().__init__()
        self.norm1, self.norm2 = norm(dim), norm(dim)
        self.attn = Attention(dim, heads)
        self.mlp = Mlp(dim, 4 * dim, dim)

    def forward(self, x, angles):
        x = x + self.attn(self.norm1(x), angles)
        return x + self.mlp(self.norm2(x))


class DecoderBlock(nn.Module):
    def __init__(self, dim, heads):
        super().__init__()
        self.norm1, self.norm2, self.norm3, self.norm_y = (norm(dim) for _ in range(4))
        self.attn = Attention(dim, heads)
        self.cross_attn = CrossAttention(dim, heads)
        self.mlp = Mlp(dim, 4 * dim, dim)

    def forward(self, x, y, x_angles, y_angles):
        x = x + self.attn(self.norm1(x), x_angles)
        x = x + self.cross_attn(self.norm2(x), self.norm_y(y), x_angles, y_angles)
        return x + self.mlp(self.norm3(x))


class Residual(nn.Module):
    def __init__(self):
        super().__init__()
        self.conv1, self.conv2 = (nn.Conv2d(FUSION, FUSION, 3, padding=1) for _ in range(2))

    def forward(self, x):
        return x + self.conv2(F.relu(self.conv1(F.relu(x))))


def double(x):
    return F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=True)


class Fusion(nn.Module):
    def __init__(self):
        super().__init__()
        self.resConfUnit1, self.resConfUnit2 = Residual(), Residual()
        self.out_conv = nn.Conv2d(FUSION, FUSION, 1)

    def forward(self, coarse, fine=None):
        x = coarse if fine is None else coarse + self.resConfUnit1(fine)
        return self.out_conv(double(self.resConfUnit2(x)))


class Scratch(nn.Module):
    def __init__(self):
        super().__init__()
        for idx, dim in enumerate(LEVELS, 1):
            setattr(self, f"layer{idx}_rn", nn.Conv2d(dim, FUSION, 3, padding=1, bias=False))
            setattr(self, f"refinenet{idx}", Fusion())


class Dpt(nn.Module):
    def __init__(self):
        super().__init__()
        tokens = [ENCODER["dim"]] + 3 * [DECODER["dim"]]
        after = [nn.ConvTranspose2d(LEVELS[0], LEVELS[0], 4, 4), nn.ConvTranspose2d(LEVELS[1], LEVELS[1], 2, 2)]
        after += [nn.Identity(), nn.Conv2d(LEVELS[3], LEVELS[3], 3, stride=2, padding=1)]
        reduce = [nn.Conv2d(a, b, 1) for a, b in zip(tokens, LEVELS)]
        self.act_postprocess = nn.ModuleList(nn.Sequential(*both) for both in zip(reduce, after))
        self.scratch = Scratch()
        self.head = nn.Sequential(
            nn.Conv2d(FUSION, LAST, 3, padding=1),
            nn.Upsample(scale_factor=2, mode="bilinear", align_corners=True),
            nn.Conv2d(LAST, LAST, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(LAST, 4, 1),
        )

    def forward(self, hooks, height, width):
        levels = []
        for idx, tokens in enumerate(hooks):
            image = self.act_postprocess[idx](tokens.transpose(1, 2).unflatten(2, (height, width)))
            levels.append(getattr(self.scratch, f"layer{idx + 1}_rn")(image))
        path = self.scratch.refinenet4(levels[3])[:, :, :height, :width]
        for idx in (3, 2, 1):
            path = getattr(self.scratch, f"refinenet{idx}")(path, levels[idx - 1])
        return self.head(path)


class Head(nn.Module):
    def __init__(self):
        super().__init__()
        self.dpt = Dpt()
        dim = ENCODER["dim"] + DECODER["dim"]
        self.head_local_features = Mlp(dim, 4 * dim, CHANNELS * PATCH * PATCH)

    def forward(self, hooks, height, width):
        """Points [batch, H, W, 3], confidence, descriptors [batch, H, W, 24], their confidence."""
        xyz, confidence = self.dpt(hooks, height, width).permute(0, 2, 3, 1).split([3, 1], -1)
        length = xyz.norm(dim=-1, keepdim=True)
        points = xyz / length.clip(min=1e-8) * torch.expm1(length)
        local = self.head_local_features(torch.cat((hooks[0], hooks[3]), -1))
        local = F.pixel_shuffle(local.transpose(1, 2).unflatten(2, (height, width)), PATCH).permute(0, 2, 3, 1)
        descriptors = F.normalize(local[..., :-1], dim=-1, eps=0.0)
        return points, 1 + confidence[..., 0].exp(), descriptors, local[..., -1].exp()


class PatchEmbed(nn.Module):
    def __init__(self):
        super().__init__()
        self.proj = nn.Conv2d(3, ENCODER["dim"], PATCH, PATCH)


class Network(nn.Module):
    def __init__(self):
        super().__init__()
        enc, dec = ENCODER["dim"], DECODER["dim"]
        self.mask_token = nn.Parameter(torch.zeros(1, 1, dec))
        self.patch_embed = PatchEmbed()
        self.enc_blocks = nn.ModuleList(EncoderBlock(enc, ENCODER["heads"]) for _ in range(ENCODER["blocks"]))
        self.enc_norm, self.dec_norm = norm(enc), norm(dec)
        self.decoder_embed = nn.Linear(enc, dec)
        decoders = [[DecoderBlock(dec, DECODER["heads"]) for _ in range(DECODER["blocks"])] for _ in range(2)]
        self.dec_blocks, self.dec_blocks2 = (nn.ModuleList(blocks) for blocks in decoders)
        self.downstream_head1, self.downstream_head2 = Head(), Head()

    def encode(self, images):
        """[2, 3, H, W] to tokens [2, N, dim]: both images at once, which is PyTorch's better way."""
        return self.enc_norm(self.encode_blocks(images))

    def encode_blocks(self, images):
        """The encoder without its last normalisation."""
        grid = self.patch_embed.proj(images)
        angles = positions(*grid.shape[2:], ENCODER["dim"] // ENCODER["heads"])
        x = grid.flatten(2).transpose(1, 2)
        for block in self.enc_blocks:
            x = block(x, angles)
        return x

    def decode(self, encoded_a, encoded_b, height, width):
        """Tokens of both sides, [batch, N, dim], at the heads' four hooks."""
        angles = positions(height, width, DECODER["dim"] // DECODER["heads"])
        a, b = self.decoder_embed(encoded_a), self.decoder_embed(encoded_b)
        hooks = [[encoded_a], [encoded_b]]
        for idx, (first, second) in enumerate(zip(self.dec_blocks, self.dec_blocks2), 1):
            a, b = first(a, b, angles, angles), second(b, a, angles, angles)
            if idx in (DECODER["blocks"] // 2, DECODER["blocks"] * 3 // 4):
                hooks[0].append(a)
                hooks[1].append(b)
        hooks[0].append(self.dec_norm(a))
        hooks[1].append(self.dec_norm(b))
        return hooks

    def heads(self, hooks, height, width):
        """Both views' outputs."""
        return [head(h, height, width) for head, h in zip((self.downstream_head1, self.downstream_head2), hooks)]
