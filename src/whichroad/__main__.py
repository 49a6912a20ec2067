"""`python -m whichroad` is `whichroad`."""

from .cli import main

main()
