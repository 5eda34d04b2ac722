"""`python -m companion`"""

from companion.cli.flights import main

main()
