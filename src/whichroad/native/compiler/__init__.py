"""A compiler of kernels: the part of Python that they are written in, to LLVM's code."""
