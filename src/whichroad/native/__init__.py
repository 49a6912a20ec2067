"""The compiled kernels: how they are built, kept, found and called.

layout   what a kernel takes, as C sees it
compiler kernels of Python to LLVM's code
lower    kernels to objects; runs in processes of its own
build    objects to a library, kept in the user's cache
cache    where that is, and by which digest it is found
library  the library found, compared with the package, called
rows     vector instructions for numba, where it compiles kernels instead
header   the same for C
"""
