"""The compiled kernels: how they are built, kept, found and called.

layout   what a kernel takes, as C sees it
lower    kernels to objects (numba, LLVM); runs in processes of its own
outer    what C calls: from a block of words to a kernel
inner    what one process lowers and the other calls
build    objects to a library, kept in the user's cache
cache    where that is, and by which digest it is found
library  the library found, compared with the package, called
header   the same for C
"""
