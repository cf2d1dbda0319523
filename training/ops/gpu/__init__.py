"""Operations as Triton kernels; triton comes with torch's builds for GPUs, and not for CPUs.

A function that runs one imports it where it is called. Tests run them on a CPU, by Triton's
interpreter, and compile them for GPUs.
"""
