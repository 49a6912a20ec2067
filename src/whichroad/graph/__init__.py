"""The road graph as the kernels see it: tables of edges, turns and vertices, and their index."""
