"""Makes the two checkpoints beside this file with the real torch.save: `python make_checkpoints.py`.

Small stand-ins for what StyleGaussian saves. Values are small fractions that f32 holds exactly, given by
formulas that the Rust test repeats. Tensors are tagged `cuda:0`, and some are views with an offset or with
swapped strides, as real ones may be.
"""

from collections import OrderedDict

import torch

N, D, L, K = 6, 5, 2, 3

torch.serialization.register_package(0, lambda storage: "cuda:0", lambda storage, location: None)


def ramp(seed, *shape):
    """((7 i + seed) mod 32) / 32 - 0.5, row-major."""
    count = torch.Size(shape).numel()
    return (((7 * torch.arange(count) + seed) % 32) / 32 - 0.5).float().reshape(shape)


def parameter(values):
    return torch.nn.Parameter(values.requires_grad_(True))


gaussians = (
    parameter(ramp(1, N, 3)),
    parameter(ramp(2, N, 3)),
    parameter(ramp(3, N, 4)),
    parameter(ramp(4, N, 1)),
)

decoder = torch.nn.Module()
decoder.kernels = torch.nn.ParameterList([ramp(6, 4, K * D), ramp(7, K * 4, 3).t()])
decoder.bias = torch.nn.ParameterList([ramp(8, 4), ramp(9, 3)])
features = ramp(5, N + 2, D)[2:]
torch.save((*gaussians, features, decoder.state_dict()), "final.pth")

layer = torch.nn.Module()
layer.layer = torch.nn.Linear(L, D)
layer.layer.weight.data = ramp(10, D, L)
layer.layer.bias.data = ramp(11, D)
assert isinstance(layer.state_dict(), OrderedDict)
torch.save(((*gaussians, parameter(ramp(12, N, L)), layer.state_dict()), 30_000), "feature.pth")
