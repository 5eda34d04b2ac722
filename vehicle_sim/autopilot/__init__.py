"""The autopilot of the vehicle itself, as far as a companion sees it: modes, arming, failsafes, control laws."""
