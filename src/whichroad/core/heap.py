"""A heap of labels, the least key first, for the route search."""

from ._jit import Ints, kernel

BITS = 14  # of a number on the heap tell the label,
_PER_NAT, _MOST_NATS = 2.0**30, 2.0**18  # the others its key
LAST = 2**63 - 1  # comes after all others


@kernel
def push(heap: Ints, n: int, label: int, key: float) -> int:
    """Put a label on the heap of n; returns the new n.

    Key and label are one whole number, so that they are compared and moved at once.
    """
    code = (int(min(key, _MOST_NATS) * _PER_NAT) << BITS) | label
    i = n
    while i > 0:
        up = (i - 1) >> 1
        if heap[up] <= code:
            break
        heap[i] = heap[up]
        i = up
    heap[i] = code
    return n + 1


@kernel
def pop(heap: Ints, n: int) -> int:
    """Take the first label off the heap of n, which then has n - 1."""
    label = heap[0] & ((1 << BITS) - 1)
    n -= 1
    code = heap[n]
    heap[n] = LAST
    i = 0
    while True:
        down = 2 * i + 1
        if down >= n:
            break
        down += int(heap[down + 1] < heap[down])
        if heap[down] >= code:
            break
        heap[i] = heap[down]
        i = down
    heap[i] = code
    return int(label)
