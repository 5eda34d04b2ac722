"""`python -m vehicle_sim`."""

from vehicle_sim.cli import main

main()
