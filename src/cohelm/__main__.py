"""`python -m cohelm` is the command `cohelm`."""

from cohelm.cli import main

main()
