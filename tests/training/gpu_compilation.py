"""Compile kernels for GPUs: `python gpu_compilation.py` reads a list of launches as JSON."""

import json
import sys
from importlib import import_module

import triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource

CAPABILITIES = (80, 90)  # of an A100 and an H100

if __name__ == "__main__":
    for item in json.load(sys.stdin):
        kernel = getattr(import_module(item["module"]), item["kernel"])
        source = ASTSource(kernel, item["signature"], item["constants"])
        for capability in CAPABILITIES:
            target = GPUTarget("cuda", capability, 32)
            options = {"num_warps": item["warps"], "enable_fp_fusion": False}
            compiled = triton.compile(source, target, options)
            print(item["kernel"], capability, len(compiled.asm["cubin"]))
