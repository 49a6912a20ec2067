"""The adapter through which the peers' harness runs us."""
