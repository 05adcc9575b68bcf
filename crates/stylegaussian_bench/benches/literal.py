"""The literal method in PyTorch: features [N, 256] stored, AdaIN, five unfolded KNN convolutions with the
sigmoid, f32.

usage: literal.py N
Prints one line of JSON: device, and milliseconds of each run without and with TF32. Rows are gathered 65,536
at a time: all at once they would be 2.5 GB for 300,000 Gaussians.
"""

import json
import sys
import time

import torch

K, WIDTHS, ROWS, RUNS = 8, [256, 256, 128, 64, 32, 3], 65536, 3


def neighbors(n, device):
    """Lists of rows that are near in memory, as the Morton order makes them."""
    offsets = torch.tensor([0, 1, -1, 2, -2, 17, -17, 33], device=device)
    return (torch.arange(n, device=device)[:, None] + offsets) % n


def transfer(f, mean, std):
    """AdaIN of [N, 256] to the statistics of a style."""
    return (f - f.mean(0)) / (f.std(0) + 1e-8) * std + mean


def decode(f, lists, layers):
    for i, (weight, bias) in enumerate(layers):
        parts = [torch.addmm(bias, f[rows].flatten(1), weight) for rows in lists.split(ROWS)]
        f = torch.cat(parts)
        if i + 1 < len(layers):
            f = torch.sigmoid_(f)
    return f


def main():
    n = int(sys.argv[1])
    device = "cuda" if torch.cuda.is_available() else "cpu"
    torch.manual_seed(0)
    f, lists = torch.randn(n, 256, device=device), neighbors(n, device)
    mean, std = torch.randn(256, device=device), torch.rand(256, device=device) + 0.5
    sizes = zip(WIDTHS, WIDTHS[1:])
    layers = [
        (torch.randn(K * i, o, device=device) / (K * i) ** 0.5, torch.zeros(o, device=device)) for i, o in sizes
    ]

    def run():
        start = time.perf_counter()
        decode(transfer(f, mean, std), lists, layers)
        if device == "cuda":
            torch.cuda.synchronize()
        return (time.perf_counter() - start) * 1e3

    result = {"device": torch.cuda.get_device_name() if device == "cuda" else "cpu", "torch": torch.__version__}
    with torch.inference_mode():
        for name, tf32 in [("f32", False), ("tf32", True)]:
            if tf32 and device == "cpu":
                continue
            torch.backends.cuda.matmul.allow_tf32 = tf32
            run()
            result[name] = [run() for _ in range(RUNS)]
    print(json.dumps(result))


if __name__ == "__main__":
    main()
